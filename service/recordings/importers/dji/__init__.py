"""DJI's and Autel's subtitles (.SRT) with their films: words, places, attitudes and lens."""
