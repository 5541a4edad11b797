"""What the vehicle's gimbal and camera say of themselves: where the one points, and whether the other has zoomed."""
