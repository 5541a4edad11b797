"""The forms that other programs read: Cursor on Target, KML, GeoJSON, CSV and CAP, and the rings that they draw."""
