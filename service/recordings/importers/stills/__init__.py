"""Pictures with EXIF and XMP: who took them where, looking which way; drones of many makers."""
