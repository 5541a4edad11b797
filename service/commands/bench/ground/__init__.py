"""What the crew's picture costs with a hundred drones, and how soon a report is on its screen."""
