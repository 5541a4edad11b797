"""Subtitles as drones write them, dialect by dialect, from a flight's known moments."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

BEGAN = datetime(2024, 6, 1, 14, 30, 0)  # local time, as the craft writes it


@dataclass(frozen=True)
class Moment:
    """A craft's place and its camera's angles from north and the horizon, degrees and metres."""

    lat_deg: float
    lon_deg: float
    above_home_m: float
    msl_m: float
    yaw_deg: float
    pitch_deg: float
    roll_deg: float
    craft_yaw_deg: float


@dataclass(frozen=True)
class Dialect:
    """`text` of a cue by its number from 0, its time in the film and its moment; how finely it is written.

    `place_deg` and `angle_deg` are a digit's step; angle 0 where the camera's angles lack.
    """

    text: Callable[[int, float, Moment], str]
    place_deg: float
    angle_deg: float = 0.0
    cue_s: float = 1.0 / 30.0
    has_msl: bool = False
    above_home_m: float = 0.001


def srt_of(dialect: Dialect, moments: Sequence[Moment], newline: str = "\n") -> str:
    """A whole file's text."""
    cues = [
        f"{number + 1}\n{_clock(number * dialect.cue_s)} --> {_clock((number + 1) * dialect.cue_s)}\n"
        f"{dialect.text(number, number * dialect.cue_s, moment)}\n"
        for number, moment in enumerate(moments)
    ]
    return "\n".join(cues).replace("\n", newline)


def _clock(time_s: float) -> str:
    ms = int(time_s * 1000 + 1e-6)
    return f"{ms // 3_600_000:02d}:{ms // 60_000 % 60:02d}:{ms // 1000 % 60:02d},{ms % 1000:03d}"


def _date(time_s: float, form: str) -> str:
    moment = BEGAN + timedelta(seconds=time_s)
    return (
        moment.strftime(form)
        .replace("MS", f"{moment.microsecond // 1000:03d}")
        .replace("US", f"{moment.microsecond % 1000:03d}")
    )


def _mini_3(number: int, time_s: float, at: Moment) -> str:
    return (
        f'<font size="28">SrtCnt : {number + 1}, DiffTime : 33ms\n{_date(time_s, "%Y-%m-%d %H:%M:%S.MS")}\n'
        "[iso : 150] [shutter : 1/5000.0] [fnum : 170] [ev : 0] [ct : 5023] [color_md : default] [focal_len : 240] "
        f"[dzoom_ratio: 10000, delta:0],[latitude: {at.lat_deg:.6f}] [longitude: {at.lon_deg:.6f}] "
        f"[rel_alt: {at.above_home_m:.3f} abs_alt: {at.msl_m:.3f}] </font>"
    )


def _mavic_2(number: int, time_s: float, at: Moment) -> str:
    return (
        f'<font size="36">FrameCnt : {number + 1}, DiffTime : 33ms\n{_date(time_s, "%Y-%m-%d %H:%M:%S,MS,US")}\n'
        "[iso : 100] [shutter : 1/400.0] [fnum : 280] [ev : 0] [ct : 5818] [color_md : default] [focal_len : 280] "
        f"[latitude : {at.lat_deg:.6f}] [longtitude : {at.lon_deg:.6f}] [altitude: {at.above_home_m:.6f}] </font>"
    )


def _mavic_2_enterprise(number: int, time_s: float, at: Moment) -> str:
    return (
        f'<font size="36">FrameCnt : {number + 1}, DiffTime : 33ms\n{_date(time_s, "%Y-%m-%d %H:%M:%S,MS,US")}\n'
        f"[color_md : default] [latitude: {at.lat_deg:.6f}] [longtitude: {at.lon_deg:.6f}] "
        f"[altitude: {at.above_home_m:.6f}] [Drone: Yaw:{at.craft_yaw_deg:.1f}, Pitch:-0.6, Roll:1.3] </font>"
    )


def _mavic_3(number: int, time_s: float, at: Moment) -> str:
    return (
        f'<font size="28">FrameCnt: {number + 1}, DiffTime: 33ms\n{_date(time_s, "%Y-%m-%d %H:%M:%S.MS")}\n'
        f"[focal_len: 24.00] [dzoom_ratio: 1.00], [latitude: {at.lat_deg:.6f}] [longitude: {at.lon_deg:.6f}] "
        f"[rel_alt: {at.above_home_m:.3f} abs_alt: {at.msl_m:.3f}] "
        f"[gb_yaw: {at.yaw_deg:.1f} gb_pitch: {at.pitch_deg:.1f} gb_roll: {at.roll_deg:.1f}] </font>"
    )


def _m300_h20n(number: int, time_s: float, at: Moment) -> str:
    """With an empty line inside, and its zoom told twice."""
    return (
        f'< font size="28" >SrtCnt : {number + 1}, DiffTime : 33ms\n{_date(time_s, "%Y-%m-%d %H:%M:%S.MS")}\n'
        f"[fnum: 1.0] [focal_len: 52.00] [dzoom: 1.79] \n[latitude: {at.lat_deg:.6f}] [longitude: {at.lon_deg:.6f}] "
        f"[rel_alt: {at.above_home_m:.3f} abs_alt: {at.msl_m:.3f}] \n"
        "[drone_speedx: 0.5 drone_speedy: -0.1 drone_speedz: 0.0] \n"
        f"[drone_yaw: {at.craft_yaw_deg:.1f} drone_pitch: -3.3 drone_roll: 0.0] \n"
        f"[gb_yaw: {at.yaw_deg:.1f} gb_pitch: {at.pitch_deg:.1f} gb_roll: {at.roll_deg:.1f}] \n\n"
        "0\n[dzoom_ratio: 17871, delta:0] < /font >"
    )


def _mavic_pro(number: int, time_s: float, at: Moment) -> str:
    return (
        f"HOME({149.0251:.4f},{-20.2532:.4f}) {_date(time_s, '%Y.%m.%d %H:%M:%S')}\n"
        f"GPS({at.lon_deg:.4f},{at.lat_deg:.4f},16) BAROMETER:{at.above_home_m:.1f}\n"
        "ISO:100 Shutter:60 EV: 0 Fnum:F2.2"
    )


def _m300_xt2(number: int, time_s: float, at: Moment) -> str:
    return (
        f"{_date(time_s, '%Y.%m.%d %H:%M:%S')}\n"
        f"GPS({at.lat_deg:.4f},{at.lon_deg:.4f},0.0M) BAROMETER:{at.above_home_m:.1f}M"
    )


def _mavic_mini(number: int, time_s: float, at: Moment) -> str:
    return (
        f"F/2.8, SS 206.14, ISO 150, EV 0, DZOOM 1.000, GPS ({at.lon_deg:.4f}, {at.lat_deg:.4f}, 10), D 2.80m, "
        f"H {at.above_home_m:.2f}m, H.S 10.00m/s, V.S 0.00m/s "
    )


def _phantom_4_rtk(number: int, time_s: float, at: Moment) -> str:
    return (
        f"F/5.6, SS 400, ISO 100, EV 0, RTK ({at.lon_deg:.6f}, {at.lat_deg:.6f}, 15), HOME (8.600000, 47.400000, "
        f"-57.98m), D 698.70m, H {at.above_home_m:.2f}m, H.S 0.00m/s, V.S 0.00m/s, F.PRY (2.7°, -7.0°, "
        f"{at.craft_yaw_deg:.1f}°), G.PRY ({at.pitch_deg:.1f}°, {at.roll_deg:.1f}°, {at.yaw_deg:.1f}°)"
    )


def _tenths(number: int, time_s: float, at: Moment) -> str:
    """Angles as the flight controller has them, in whole tenths."""
    return (
        f"GPS ({at.lon_deg:.6f}, {at.lat_deg:.6f}, 15), HOME (149.025100, -20.253200, 0.00m), D 0.00m, "
        f"H {at.above_home_m:.2f}m, F.PRY (27, -70, {round(at.craft_yaw_deg * 10)}), "
        f"G.PRY ({round(at.pitch_deg * 10)}, {round(at.roll_deg * 10)}, {round(at.yaw_deg * 10)})"
    )


def _autel(number: int, time_s: float, at: Moment) -> str:
    east, north = "E" if at.lon_deg >= 0 else "W", "N" if at.lat_deg >= 0 else "S"
    return (
        f"HOME({east}: {abs(at.lon_deg):.6f}, {north}: {abs(at.lat_deg):.6f}) {_date(time_s, '%Y-%m-%d %H:%M:%S')}\n"
        f"GPS({east}: {abs(at.lon_deg):.6f}, {north}: {abs(at.lat_deg):.6f}, {at.above_home_m:06.2f}m) \n"
        f"ISO:100 SHUTTER:30 EV:0.0 F-NUM:2.8 \nF.PRY (-1.0°, 1.0°, {at.craft_yaw_deg:.1f}°), "
        f"G.PRY ({at.pitch_deg:.1f}°, {at.roll_deg:.1f}°, {at.yaw_deg:.1f}°)"
    )


def _comma_decimals(number: int, time_s: float, at: Moment) -> str:
    """As written, or saved again, where numbers have a decimal comma."""
    return _mavic_3(number, time_s, at).replace(".", ",")


DIALECTS = {
    "Mini 3": Dialect(_mini_3, 1e-6, has_msl=True),
    "Mavic 2": Dialect(_mavic_2, 1e-6),
    "Mavic 2 Enterprise": Dialect(_mavic_2_enterprise, 1e-6),
    "Mavic 3": Dialect(_mavic_3, 1e-6, 0.1, has_msl=True),
    "Matrice 300 H20N": Dialect(_m300_h20n, 1e-6, 0.1, has_msl=True),
    "Mavic Pro": Dialect(_mavic_pro, 1e-4, cue_s=1.0, above_home_m=0.1),
    "Matrice 300 XT2": Dialect(_m300_xt2, 1e-4, cue_s=1.0, above_home_m=0.1),
    "Mavic Mini": Dialect(_mavic_mini, 1e-4, cue_s=1.0, above_home_m=0.01),
    "Phantom 4 RTK": Dialect(_phantom_4_rtk, 1e-6, 0.1, cue_s=1.0, above_home_m=0.01),
    "tenths of a degree": Dialect(_tenths, 1e-6, 0.1, above_home_m=0.01),
    "Autel": Dialect(_autel, 1e-6, 0.1, cue_s=1.0, above_home_m=0.01),
    "decimal commas": Dialect(_comma_decimals, 1e-6, 0.1, has_msl=True),
}
