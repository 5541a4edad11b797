from pathlib import Path

from service.commands.check.tak import check_tak
from service.config.sections import TakConfig
from tests.support.certificates import Authority
from tests.support.ports import free_port
from tests.support.tak_server import Server


def test_each_url_is_tried_and_what_fails_says_why(tmp_path: Path) -> None:
    authority = Authority(tmp_path / "ca")
    with Server() as server:
        urls = (f"tcp://127.0.0.1:{server.port}", f"tcp://127.0.0.1:{free_port()}", "udp://239.2.3.1:6969")
        there, nobody, group = check_tak(TakConfig(urls=urls, interface="127.0.0.1"))
        assert (there.level, nobody.level, group.level) == ("ok", "fail", "ok")
        assert "connection refused" in str(nobody) and "not known" in str(group)
        (plain,) = check_tak(
            TakConfig(urls=(f"tls://no-such-host.invalid:{server.port}",), ca_certificate=str(authority.ca))
        )
        assert plain.level == "fail" and "no such host" in str(plain)
    (key,) = check_tak(TakConfig(urls=("tls://127.0.0.1:1",), ca_certificate="/none"))
    assert key.level == "fail" and "tak.ca_certificate" in str(key)
    assert check_tak(TakConfig()) == []
