"""`study segmentation`: any segmenter on folders of images, by folder and by fire."""
