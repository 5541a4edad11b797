"""Takes what is secret out of text: whatever goes into a line, a log, a status or a recording passes here."""

import re

HIDDEN = "***"
_USER_INFO = re.compile(
    r"(?P<scheme>\b[A-Za-z][A-Za-z0-9+.-]{0,30}:(?://)?|\b(?:tcp|udp|tls|quic|ws|wss)/)"
    r"(?P<user>[^\s/?#\"'<>@:]{0,200}):(?P<secret>[^\s\"'<>]{0,1000})@"
)
_PARAMETER = re.compile(
    r"(?P<key>(?:^|[?&;#\s\"',])[A-Za-z0-9_.-]*(?:pass(?:word|wd)?|pwd?|secret|token|key|auth|signature|sig|credential)"
    r"[A-Za-z0-9_.-]*=)(?P<secret>[^&;#\s\"'<>]+)",
    re.IGNORECASE,
)


def redacted(text: str) -> str:
    """The text with the passwords of its URLs, and secrets in their queries, as ***; all else stays as it is."""
    return _PARAMETER.sub(rf"\g<key>{HIDDEN}", _USER_INFO.sub(rf"\g<scheme>\g<user>:{HIDDEN}@", text))
