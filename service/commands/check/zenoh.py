"""The doctor's look at zenoh: each endpoint that is connected to, and whether the own ones can be opened."""

import time

import msgspec
import zenoh

from service.commands.check.finding import Finding, fail, ok, warn
from service.config.sections import ConfigError, ZenohConfig
from service.publish.zenoh import zenoh_config

_POLL_S = 0.05


def check_zenoh(config: ZenohConfig, listen_s: float) -> list[Finding]:
    """What can be said within `listen_s` an endpoint; blocks."""
    if not config.enabled:
        return [ok("zenoh", "switched off; reports go by MAVLink only")]
    if not config.connect and not config.listen:
        mend = "set zenoh.listen, e.g. ['tcp/0.0.0.0:7447'], or zenoh.connect"
        return [warn("zenoh", "neither listens nor connects: nobody can hear the reports", mend)]
    findings = [_try_connect(config, endpoint, listen_s / len(config.connect)) for endpoint in config.connect]
    if config.listen:
        findings.append(_try_listen(config))
    return findings


def _try_connect(config: ZenohConfig, endpoint: str, listen_s: float) -> Finding:
    mend = f"start what listens there, and check the address, the firewall and TLS ({endpoint})"
    try:
        with zenoh.open(zenoh_config(msgspec.structs.replace(config, connect=(endpoint,), listen=()))) as session:
            start_s = time.monotonic()
            while not (session.info.peers_zid() or session.info.routers_zid()):
                if time.monotonic() - start_s > listen_s:
                    return fail("zenoh", f"nobody answers at {endpoint} in {listen_s:.0f} s", mend)
                time.sleep(_POLL_S)
            return ok("zenoh", f"connected to {endpoint}")
    except ConfigError as error:
        return fail("zenoh", str(error), "correct that key")
    except zenoh.ZError as error:
        return fail("zenoh", f"{endpoint}: {_first_line(error)}", mend)


def _try_listen(config: ZenohConfig) -> Finding:
    places = ", ".join(config.listen)
    try:
        with zenoh.open(zenoh_config(msgspec.structs.replace(config, mode="peer", connect=()))):
            return ok("zenoh", f"can listen on {places}")
    except ConfigError as error:
        return fail("zenoh", str(error), "correct that key")
    except zenoh.ZError as error:
        mend = "free the port: if distloc runs already, systemctl stop distloc first; else correct zenoh.listen"
        return fail("zenoh", f"cannot listen on {places}: {_first_line(error)}", mend)


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:160]
