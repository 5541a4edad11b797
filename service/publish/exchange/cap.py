"""A fire as a CAP 1.2 alert (OASIS), as a draft: a person reads it, completes it and sends it. We never do."""

from html import escape

from service.common.shown import shown
from service.publish.exchange.fire import SharedFire
from service.publish.exchange.rings import ellipse_ring
from service.publish.wire import utc_text

CAP = "application/cap+xml"
_NAMESPACE = "urn:oasis:names:tc:emergency:cap:1.2"
_CERTAINTY = {"confirmed": "Likely", "coasting": "Likely", "tentative": "Possible", "dismissed": "Unlikely"}


def draft(fire: SharedFire, now_s: float) -> bytes | None:
    """The draft; None where there is no area to warn of."""
    ring = fire.place and ellipse_ring(*fire.place, fire.report.properties.ellipse95, 36)
    if not ring:
        return None
    sent = f"{(utc_text(now_s) or '')[:19]}-00:00"
    identity = "".join(one if one.isalnum() or one in "._-" else "_" for one in f"{fire.uid}.{int(now_s)}")
    info = (
        _tag("category", "Fire")
        + _tag("event", "Wildfire smoke")
        + _tag("urgency", "Unknown")
        + _tag("severity", "Unknown")
        + _tag("certainty", "Unlikely" if fire.is_no_fire else _CERTAINTY[fire.report.properties.state])
        + _tag("headline", fire.title)
        + _tag("description", "\n".join(fire.says))
        + "<area>"
        + _tag("areaDesc", "Where the fire is with 95 % probability")
        + _tag("polygon", " ".join(f"{lat:.6f},{lon:.6f}" for lon, lat in ring))
        + "</area>"
    )
    body = (
        _tag("identifier", identity)
        + _tag("sender", "distloc")
        + _tag("sent", sent)
        + _tag("status", "Draft")
        + _tag("msgType", "Alert")
        + _tag("scope", "Private")
        + _tag("addresses", "none")
        + _tag("note", "A draft that no person has approved. Not to be sent as it is.")
        + f"<info>{info}</info>"
    )
    text = f'<?xml version="1.0" encoding="UTF-8"?>\n<alert xmlns="{_NAMESPACE}">{body}</alert>\n'
    return text.encode("utf-8", "xmlcharrefreplace")


def _tag(name: str, text: str) -> str:
    return f"<{name}>{escape(shown(text, keep=chr(10), most=4_000), quote=False)}</{name}>"
