"""What lies under the fires: image tiles of a file or a server, hill shade of a DEM, places; all are the operator's."""
