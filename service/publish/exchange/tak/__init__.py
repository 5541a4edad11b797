"""Cursor on Target: the events, what is due of them, and who carries them to TAK clients and servers."""
