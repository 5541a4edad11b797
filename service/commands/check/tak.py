"""The doctor's look at [tak]: whether each server takes us, with its certificate and ours."""

from service.commands.check.finding import Finding, fail, ok
from service.config.sections import ConfigError, TakConfig
from service.publish.exchange.tak.channel import TakLinkError
from service.publish.exchange.tak.publisher import channels


def check_tak(config: TakConfig) -> list[Finding]:
    """One for each URL, after 10 s at most each; nothing is sent. Blocks."""
    if not config.urls:
        return []
    try:
        made = channels(config)
    except ConfigError as error:
        return [fail("tak", str(error), "correct that key")]
    findings = []
    for name, connect in made:
        try:
            channel = connect()
            try:
                channel.poll()
            finally:
                channel.close()
        except TakLinkError as error:
            mend = f"start what listens there; check the address, the firewall and the certificates ({name})"
            findings.append(fail("tak", f"{name}: {error}", mend))
        else:
            said = f"sends to {name}; whether anybody hears it is not known" if name.startswith("udp") else None
            findings.append(ok("tak", said or f"connected to {name}"))
    return findings
