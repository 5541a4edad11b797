"""Pictures as drones write them: EXIF through Pillow, XMP packets by hand, maker by maker."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, TiffImagePlugin

from tests.support.srt_lines import Moment

_HEAD = '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n<x:xmpmeta xmlns:x="adobe:ns:meta/">\n'
_HEAD += '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
_TAIL = '</rdf:RDF>\n</x:xmpmeta>\n<?xpacket end="w"?>'


def packet(prefix: str, address: str, values: Mapping[str, str], as_elements: bool = False) -> bytes:
    """An XMP packet whose values are attributes or elements of one description."""
    names = f'xmlns:{prefix}="{address}" '
    if as_elements:
        inner = "".join(f"<{prefix}:{name}>{value}</{prefix}:{name}>\n" for name, value in values.items())
        text = f'<rdf:Description rdf:about="" {names}>\n{inner}</rdf:Description>\n'
    else:
        inner = "\n ".join(f'{prefix}:{name}="{value}"' for name, value in values.items())
        text = f'<rdf:Description rdf:about="DJI Meta Data" {names}\n {inner}>\n</rdf:Description>\n'
    return (_HEAD + text + _TAIL).encode()


def dji(at: Moment) -> bytes:
    return packet(
        "drone-dji",
        "http://www.dji.com/drone-dji/1.0/",
        {
            "AbsoluteAltitude": f"{at.msl_m:+.3f}",
            "RelativeAltitude": f"{at.above_home_m:+.3f}",
            "GpsLatitude": f"{at.lat_deg:.9f}",
            "GpsLongtitude": f"{at.lon_deg:.9f}",
            "GimbalRollDegree": f"{at.roll_deg:+.2f}",
            "GimbalYawDegree": f"{at.yaw_deg:+.2f}",
            "GimbalPitchDegree": f"{at.pitch_deg:+.2f}",
            "FlightRollDegree": "+1.00",
            "FlightYawDegree": f"{at.craft_yaw_deg:+.2f}",
            "FlightPitchDegree": "-2.00",
        },
    )


def autel(at: Moment) -> bytes:
    return packet(
        "drone",
        "http://www.autelrobotics.com/drone/1.0/",
        {
            "AbsoluteAltitude": f"{at.msl_m:.3f}",
            "RelativeAltitude": f"{at.above_home_m:.3f}",
            "GpsLatitude": f"{at.lat_deg:.9f}",
            "GpsLongtitude": f"{at.lon_deg:.9f}",
            "GimbalRollDegree": f"{at.roll_deg:.2f}",
            "GimbalYawDegree": f"{at.yaw_deg:.2f}",
            "GimbalPitchDegree": f"{at.pitch_deg:.2f}",
        },
    )


def parrot(at: Moment) -> bytes:
    return packet(
        "drone-parrot",
        "http://www.parrot.com/drone-parrot/1.0/",
        {
            "CameraYawDegree": f"{at.yaw_deg:.6f}",
            "CameraPitchDegree": f"{at.pitch_deg:.6f}",
            "CameraRollDegree": f"{at.roll_deg:.6f}",
            "DroneYawDegree": f"{at.craft_yaw_deg:.6f}",
            "DronePitchDegree": "-2.0",
            "DroneRollDegree": "1.0",
        },
        as_elements=True,
    )


def _skydio_values(at: Moment) -> dict[str, str]:
    return {
        "Latitude": f"{at.lat_deg:.9f}",
        "Longitude": f"{at.lon_deg:.9f}",
        "AbsoluteAltitude": f"{at.msl_m:.3f}",
        "RelativeAltitude": f"{at.above_home_m:.3f}",
    }


def skydio_elements(at: Moment) -> bytes:
    """Structures as resources, as newer firmware writes them; the other frame's angles are another's."""
    angles = f"<drone-skydio:Roll>{at.roll_deg:.4f}</drone-skydio:Roll><drone-skydio:Pitch>{at.pitch_deg:.4f}"
    angles += f"</drone-skydio:Pitch><drone-skydio:Yaw>{at.yaw_deg:.4f}</drone-skydio:Yaw>"
    other = "<drone-skydio:Roll>7</drone-skydio:Roll><drone-skydio:Pitch>8</drone-skydio:Pitch><drone-skydio:Yaw>9"
    other += "</drone-skydio:Yaw>"
    values = {
        **_skydio_values(at),
        "CameraOrientationFLU": f'<rdf:Description rdf:parseType="Resource">{other}</rdf:Description>',
        "CameraOrientationNED": f'<rdf:Description rdf:parseType="Resource">{angles}</rdf:Description>',
    }
    return packet("drone-skydio", "https://www.skydio.com/drone-skydio/1.0/", values, as_elements=True)


def skydio_attributes(at: Moment) -> bytes:
    """Structures as attributes of an element of their own, as older firmware writes them."""
    names = 'xmlns:drone-skydio="https://www.skydio.com/drone-skydio/1.0/"'
    flat = " ".join(f'drone-skydio:{name}="{value}"' for name, value in _skydio_values(at).items())
    text = f'<rdf:Description rdf:about="" {names} {flat}>\n'
    text += '<drone-skydio:CameraOrientationFLU drone-skydio:Roll="7" drone-skydio:Pitch="8" drone-skydio:Yaw="9"/>\n'
    text += f'<drone-skydio:CameraOrientationNED drone-skydio:Roll="{at.roll_deg:.4f}" '
    text += f'drone-skydio:Pitch="{at.pitch_deg:.4f}" drone-skydio:Yaw="{at.yaw_deg:.4f}"/>\n</rdf:Description>\n'
    return (_HEAD + text + _TAIL).encode()


def teledyne(at: Moment) -> bytes:
    """DJI's names under a prefix of its own, fractions as FLIR writes its numbers."""
    return packet(
        "drone-flir",
        "http://ns.flir.com/drone/1.0/",
        {
            "RelativeAltitude": f"{round(at.above_home_m * 1000)}/1000",
            "AbsoluteAltitude": f"{round(at.msl_m * 1000)}/1000",
            "GpsLatitude": f"{at.lat_deg:.9f}",
            "GpsLongitude": f"{at.lon_deg:.9f}",
            "GimbalYawDegree": f"{round(at.yaw_deg * 100)}/100",
            "GimbalPitchDegree": f"{round(at.pitch_deg * 100)}/100",
            "GimbalRollDegree": f"{round(at.roll_deg * 100)}/100",
        },
        as_elements=True,
    )


MAKERS: dict[str, tuple[str, Callable[[Moment], bytes]]] = {
    "DJI": ("DJI", dji),
    "Autel": ("Autel Robotics", autel),
    "Parrot": ("Parrot", parrot),
    "Skydio, elements": ("Skydio", skydio_elements),
    "Skydio, attributes": ("Skydio", skydio_attributes),
    "Teledyne FLIR": ("Teledyne FLIR", teledyne),
}


def exif_of(make: str, at: Moment | None, time: str, **extra: Any) -> Image.Exif:
    """EXIF with a place to 1e-5 seconds of arc and a time; `extra` replaces tags of the Exif directory by number."""
    exif = Image.Exif()
    exif[0x010F], exif[0x0110] = make, "M1"
    tags = exif.get_ifd(0x8769)
    if time:
        tags[0x9003] = time
    for name, value in extra.items():
        tags[int(name.removeprefix("tag_"), 16)] = value
    if at is not None:
        gps = exif.get_ifd(0x8825)
        gps[1], gps[2] = "N" if at.lat_deg >= 0 else "S", _arc(abs(at.lat_deg))
        gps[3], gps[4] = "E" if at.lon_deg >= 0 else "W", _arc(abs(at.lon_deg))
        gps[5], gps[6] = b"\1" if at.msl_m < 0 else b"\0", abs(round(at.msl_m, 3))
    return exif


def _arc(degrees: float) -> tuple[float, float, float]:
    whole = int(degrees)
    minutes = (degrees - whole) * 60.0
    return float(whole), float(int(minutes)), round((minutes - int(minutes)) * 60.0, 5)


def write_picture(
    path: Path, exif: Image.Exif, xmp: bytes = b"", image: NDArray[np.uint8] | None = None, quality: int = 90
) -> Path:
    """A JPEG or TIFF of an image (H, W, 3) BGR, 64 x 48 grey where none is given."""
    pixels = np.full((48, 64, 3), 128, np.uint8) if image is None else image[:, :, ::-1]
    if path.suffix.lower() in (".tif", ".tiff"):
        Image.fromarray(pixels).save(path, tiffinfo=_directory(exif, xmp))
    else:
        Image.fromarray(pixels).save(path, exif=exif, quality=quality, xmp=xmp)
    return path


def _directory(exif: Image.Exif, xmp: bytes) -> TiffImagePlugin.ImageFileDirectory_v2:
    """The same as a TIFF's own tags."""
    directory = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, value in exif.items():
        directory[tag] = value
    for tag in (0x8769, 0x8825):
        directory[tag] = dict(exif.get_ifd(tag))
    if xmp:
        directory[700] = xmp
    return directory
