"""`distloc ground`: the crew's picture in a browser, or with `--print` line by line."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from service.commands.errors import MissingExtraError, OutputError
from service.commands.say import say
from service.common.shown import shown

if TYPE_CHECKING:
    from service.config.sections import TakConfig

Connect = Annotated[list[str] | None, typer.Option(help="Endpoint of a vehicle or router, e.g. tcp/192.0.2.1:7447.")]
Listen = Annotated[list[str] | None, typer.Option(help="Endpoint that vehicles connect to, e.g. tcp/0.0.0.0:7447.")]
Config = Annotated[
    Path | None, typer.Option(help="A TOML file: its [zenoh] has the certificates, the password and where to connect.")
]
TOKEN_BYTES = 16


def ground(
    connect: Connect = None,
    listen: Listen = None,
    config: Config = None,
    out: Annotated[Path | None, typer.Option(help="With --print: append each report's JSON to this file.")] = None,
    lines: Annotated[bool, typer.Option("--print", help="Print reports and states; serve no page.")] = False,
    host: Annotated[str, typer.Option(help="Address to serve the page on; others than this computer need a token.")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, typer.Option(min=0, max=65_535, help="Port of the page; 0: any that is free.")] = 8080,
    token_file: Annotated[
        str | None, typer.Option(help="A file of mode 0600 with the token; left out: a new one at each start.")
    ] = None,
    record: Annotated[Path | None, typer.Option(help="Keep what arrives in this folder, a file a day.")] = None,
    record_gb: Annotated[float, typer.Option(min=0.001, max=100_000.0, help="Most that the record may take.")] = 4.0,
    tiles: Annotated[
        str | None,
        typer.Option(help="Images under the fires: an MBTiles or PMTiles file, or a server's URL with {z}, {x}, {y}."),
    ] = None,
    dem: Annotated[
        Path | None, typer.Option(help="Without --tiles: hill shade of this DEM, a file or a folder.")
    ] = None,
    attribution: Annotated[str, typer.Option(help="Whom the page names as the tiles' or the DEM's source.")] = "",
    places: Annotated[Path | None, typer.Option(help="A GeoJSON file of places, roads or parcels to draw.")] = None,
    tak: Annotated[
        list[str] | None,
        typer.Option(
            help="Send the fires as Cursor on Target: udp://239.2.3.1:6969, tcp://HOST:8087, tls://HOST:8089."
        ),
    ] = None,
    replay: Annotated[Path | None, typer.Option(help="Show this file of a record instead of hearing drones.")] = None,
    export: Annotated[
        Path | None, typer.Option(help="With --replay: write the mission as one HTML file, and end.")
    ] = None,
    speed: Annotated[float, typer.Option(min=0.01, max=1_000.0, help="Of the replay, times its own.")] = 1.0,
) -> None:
    """Show the drones, their fires and how sure they are on a map in the browser; --print: line by line."""
    from service.config.load import load_config

    said = load_config(config) if config else None
    access = said.zenoh if said else None
    to_tak = _tak(said.tak if said else None, tak)
    if access is not None and not (connect or listen):
        connect, listen = list(access.connect), list(access.listen)
    if replay is None and not (connect or listen):
        raise typer.BadParameter(
            "needs --connect, --listen, --replay, or connect or listen in [zenoh] of --config: where are the drones?",
            param_hint="--connect",
        )
    if replay is not None and record is not None:
        raise typer.BadParameter(
            "a replay is no news, and its marks would be taken for those of now: leave --record or --replay out",
            param_hint="--record",
        )
    if tak and (replay is not None or lines):
        raise typer.BadParameter("goes neither with a replay, which is no news, nor with --print", param_hint="--tak")
    if lines:
        raise typer.Exit(_printed(connect or [], listen or [], config, out))
    if out is not None:
        raise typer.BadParameter("goes with --print; --record keeps what arrives", param_hint="--out")
    try:
        from service.ground.crew import Settings, serve
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"the page needs {error.name}: pip install 'distloc[ground]'; or give --print, which needs nothing"
        ) from error
    if export is not None:
        _exported(replay, export)
        return
    from service.common import aio
    from service.config.secret_file import read_secret

    settings = Settings(
        connect=tuple(connect or ()),
        listen=tuple(listen or ()),
        access=access,
        host=host,
        port=port,
        token=_token(read_secret("--token-file", token_file)) if token_file else "",
        record=record,
        most_bytes=round(record_gb * 1e9),
        replay=replay,
        speed=speed,
        tiles=tiles,
        dem=dem,
        attribution=attribution,
        places=places,
        tak=to_tak,
    )
    aio.run(serve(settings, lambda line: typer.echo(shown(line))))  # with the token, which `say` would hide


def _tak(section: "TakConfig | None", urls: list[str] | None) -> "TakConfig":
    """The config's [tak], with the URLs of the options in place of its own."""
    from service.config.sections import TakConfig

    section = section or TakConfig()
    return msgspec.structs.replace(section, urls=tuple(urls)) if urls else section


def _exported(replay: Path | None, export: Path) -> None:
    from service.common.files import write_whole
    from service.ground.record.recorder import Foreign, read
    from service.ground.record.review import review

    if replay is None:
        raise typer.BadParameter("needs --replay FILE: the record to tell of", param_hint="--export")
    try:
        foreign = Foreign()
        page = review(read(replay, foreign), f"distloc: {replay.stem}")
        write_whole(export, page)
    except OSError as error:
        raise OutputError(f"{error.filename or export}: {error.strerror}") from error
    if foreign.count:
        say(f"{replay}: left out what is no line of a record: {foreign.count}, the first of them line {foreign.first}")
    say(f"wrote {export}")


def _printed(connect: list[str], listen: list[str], config: Path | None, out: Path | None) -> int:
    from service.ground.station import main

    arguments = [part for endpoint in connect for part in ("--connect", endpoint)]
    arguments += [part for endpoint in listen for part in ("--listen", endpoint)]
    arguments += ["--config", str(config)] if config else []
    return main(arguments + (["--out", str(out)] if out else []))


def _token(secret: bytes) -> str:
    token = secret.decode("ascii", "replace").strip()
    if len(token) < TOKEN_BYTES or not token.isascii() or not token.replace("-", "").replace("_", "").isalnum():
        raise typer.BadParameter(
            f"the token has {len(token)} characters: give 16 or more letters, digits, - and _",
            param_hint="--token-file",
        )
    return token
