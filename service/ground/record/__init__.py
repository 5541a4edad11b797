"""What the ground keeps: what arrived, pictures of before, marks; and how it is shown again."""
