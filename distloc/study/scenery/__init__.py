"""What corners of the scenery add to a target's place; `distloc study scenery` calls it."""
