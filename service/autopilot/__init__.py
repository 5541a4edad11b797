"""MAVLink frames to a camera pose at any time, and its errors; the localise stage and the flight call it."""
