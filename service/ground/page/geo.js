/** Places on the WGS 84 ellipsoid: metres a degree, distance and bearing, and places as people write them. */

const A_M = 6378137.0;
const E2 = 0.00669437999014;
const RAD = Math.PI / 180;

/** @typedef {{lat: number, lon: number}} Place */

/** @param {number} latDeg @returns {{north: number, east: number}} metres a degree of latitude and of longitude */
export function metresADegree(latDeg) {
  const s = Math.sin(latDeg * RAD);
  const w = 1 - E2 * s * s;
  return {
    north: (RAD * A_M * (1 - E2)) / (w * Math.sqrt(w)),
    east: (RAD * A_M * Math.cos(latDeg * RAD)) / Math.sqrt(w),
  };
}

/** @param {Place} a @param {Place} b @returns {{distance: number, bearing: number}} metres; degrees from north at `a` */
export function fromTo(a, b) {
  const dLon = ((((b.lon - a.lon + 180) % 360) + 360) % 360) - 180;
  const middle = metresADegree((a.lat + b.lat) / 2);
  const near = Math.hypot((b.lat - a.lat) * middle.north, dLon * middle.east);
  const [p, q] = [a.lat * RAD, b.lat * RAD];
  const y = Math.sin(dLon * RAD) * Math.cos(q);
  const x = Math.cos(p) * Math.sin(q) - Math.sin(p) * Math.cos(q) * Math.cos(dLon * RAD);
  const h = Math.sin((q - p) / 2) ** 2 + Math.cos(p) * Math.cos(q) * Math.sin((dLon * RAD) / 2) ** 2;
  const far = 2 * 6371008.8 * Math.asin(Math.min(1, Math.sqrt(h)));
  return { distance: near < 100000 ? near : far, bearing: (Math.atan2(y, x) / RAD + 360) % 360 };
}

/** @param {Place} place @returns {string} degrees and decimal minutes, to a thousandth: 47° 25.664' N  008° 36.335' E */
export function minutes(place) {
  return `${oneAngle(place.lat, "N", "S", 2)}  ${oneAngle(place.lon, "E", "W", 3)}`;
}

/** @param {number} deg @param {string} plus @param {string} minus @param {number} digits */
function oneAngle(deg, plus, minus, digits) {
  const thousandths = Math.round(Math.abs(deg) * 60000);
  const whole = String(Math.floor(thousandths / 60000)).padStart(digits, "0");
  const rest = ((thousandths % 60000) / 1000).toFixed(3).padStart(6, "0");
  return `${whole}° ${rest}' ${deg >= 0 || thousandths === 0 ? plus : minus}`;
}

/** @param {string} text decimal degrees, or degrees and minutes with N, S, E, W @returns {Place | null} */
export function placeOf(text) {
  const parts = text.toUpperCase().replace(/[°'′"″,;]/g, " ").match(/-?\d+(?:\.\d+)?|[NSEW]/g) ?? [];
  /** @type {number[]} */ let numbers = [];
  /** @type {number[]} */ const angles = [];
  for (const part of parts) {
    if (!/[NSEW]/.test(part)) {
      numbers.push(Number(part));
      continue;
    }
    if (numbers.length < 1 || numbers.length > 3) return null;
    const angle = numbers[0] + (numbers[1] ?? 0) / 60 + (numbers[2] ?? 0) / 3600;
    angles.push(/[SW]/.test(part) ? -angle : angle);
    numbers = [];
  }
  const [lat, lon] = angles.length === 2 && numbers.length === 0 ? angles : angles.length === 0 ? numbers : [];
  const isPair = angles.length === 2 || numbers.length === 2;
  return isPair && Math.abs(lat) <= 90 && Math.abs(lon) <= 180 ? { lat, lon } : null;
}

/** @param {number | null} m @returns {string} 180 m, 4.10 km */
export function metres(m) {
  if (m === null || !Number.isFinite(m)) return "unknown";
  if (m < 1000) return `${Math.round(m)}\u00a0m`;
  return `${(m / 1000).toFixed(m < 10000 ? 2 : m < 100000 ? 1 : 0)}\u00a0km`;
}

/** @param {{semi_major_m: number | null, semi_minor_m: number | null}} one @returns {string} its half-lengths */
export function within(one) {
  if (one.semi_major_m === null || one.semi_minor_m === null) return "unknown";
  return `±\u00a0${metres(one.semi_major_m)} ×\u00a0${metres(one.semi_minor_m)}`;
}

/** @param {number | null} deg @returns {string} three digits, as a bearing is read out */
export function bearing(deg) {
  return deg === null ? "unknown" : `${String(Math.round(deg) % 360).padStart(3, "0")}°`;
}

/** @param {number | null} s @returns {string} 5 s, 3 min, 2 h 5 min */
export function age(s) {
  if (s === null || !Number.isFinite(s)) return "unknown";
  const whole = Math.max(0, Math.round(s));
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min`;
  return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
}

/** @param {number | null} s seconds since 1970 @returns {string} the time of day here, with seconds */
export function clock(s) {
  return s === null ? "unknown" : new Date(s * 1000).toLocaleTimeString("en-GB");
}
