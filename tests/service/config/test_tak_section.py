import pytest

from service.config.load import load_config
from service.config.sections import ConfigError, TakConfig
from service.config.tak_section import TakUrl, check_tak, tak_url


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("udp://239.2.3.1:6969", TakUrl("udp", "239.2.3.1", 6969)),
        ("tcp://tak.example:8087", TakUrl("tcp", "tak.example", 8087)),
        ("tls://[2001:db8::1]:8089", TakUrl("tls", "2001:db8::1", 8089)),
    ],
)
def test_urls(text: str, url: TakUrl) -> None:
    assert tak_url("tak.urls[0]", text) == url and url.text == text


@pytest.mark.parametrize(
    "text",
    [
        *("", "tak.example:8087", "http://tak.example:80", "tcp://tak.example", "tcp://tak.example:0", "tcp://:8087"),
        *("tcp://tak.example:65536", "tcp://a b:1", "tcp://user:secret@tak.example:1", "tcp://x:1\n", "tcp://x:1/path"),
        "tcp://" + "x" * 10_000 + ":1",
    ],
)
def test_what_is_no_url_is_one_line(text: str) -> None:
    with pytest.raises(ConfigError, match=r"^tak.urls\[0\] is '") as found:
        tak_url("tak.urls[0]", text)
    assert len(str(found.value)) < 300 and "\n" not in str(found.value)


@pytest.mark.parametrize(
    ("config", "said"),
    [
        (TakConfig(private_key="a"), "tak.private_key"),
        (TakConfig(password_file="a"), "tak.password_file"),
        (TakConfig(urls=("tcp://x:1",), certificate="a"), "tls://"),
        (TakConfig(urls=("udp://239.2.3.1:6969",), interface="eth0"), "tak.interface is 'eth0'"),
    ],
)
def test_keys_that_contradict_each_other(config: TakConfig, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        check_tak(config)


def test_the_files_section(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "config.toml"
    path.write_text('[tak]\nurls = ["udp://239.2.3.1:6969"]\n')
    assert load_config(path).tak.urls == ("udp://239.2.3.1:6969",)
    path.write_text('[tak]\nurls = ["udp://239.2.3.1"]\n')
    with pytest.raises(ConfigError, match=r"tak.urls\[0\]"):
        load_config(path)
    path.write_text("[tak]\nurls = [" + ", ".join(['"tcp://x:1"'] * 5) + "]\n")
    with pytest.raises(ConfigError):
        load_config(path)
