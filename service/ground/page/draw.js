/** What the canvas over the map shows: grid, drones, fires. Draws on a 2D context with a projection; knows no map. */

import { metresADegree } from "./geo.js";
import { kindOf, nameOf } from "./store.js";

/** @typedef {(lat: number, lon: number) => {x: number, y: number}} Project */
/** @typedef {{ctx: CanvasRenderingContext2D, project: Project, width: number, height: number,
 *   density: number, colours: Record<string, string>}} Sheet */

const FRESH_S = 30;
const OLD_S = 900;
const LARGEST_M = 200000;
const HIDDEN_PX = 6;

/** @param {number | null} ageS @returns {number} 1 while fresh, 0.4 from a quarter of an hour on */
export function freshness(ageS) {
  if (ageS === null) return 0.4;
  const share = Math.min(1, Math.max(0, (ageS - FRESH_S) / (OLD_S - FRESH_S)));
  return 1 - 0.6 * share;
}

/** @type {Map<string, HTMLCanvasElement>} */ const stamps = new Map();
const STAMP_PX = 32;

/** The symbol of a state, drawn once for each colour and density of the screen and then stamped: a thousand cost little.
 * @param {Sheet} sheet @param {string} kind @param {number} x @param {number} y */
function stamp(sheet, kind, x, y) {
  const density = sheet.density;
  const name = `${kind} ${sheet.colours[kind]} ${density}`;
  let made = stamps.get(name);
  if (!made) {
    made = document.createElement("canvas");
    made.width = made.height = STAMP_PX * density;
    const ctx = /** @type {CanvasRenderingContext2D} */ (made.getContext("2d"));
    ctx.scale(density, density);
    symbol(ctx, kind, STAMP_PX / 2, STAMP_PX / 2, 11, sheet.colours);
    if (stamps.size > 50) stamps.clear();
    stamps.set(name, made);
  }
  // On whole pixels of the screen: between them each would be filtered, which takes longer than all the rest.
  const corner = (/** @type {number} */ middle) => Math.round((middle - STAMP_PX / 2) * density) / density;
  sheet.ctx.drawImage(made, corner(x), corner(y), STAMP_PX, STAMP_PX);
}

/** A shape of its own for each state, so that colour is never all that tells. */
function symbol(
  /** @type {CanvasRenderingContext2D} */ ctx,
  /** @type {string} */ kind,
  /** @type {number} */ x,
  /** @type {number} */ y,
  /** @type {number} */ r,
  /** @type {Record<string, string>} */ colours,
) {
  ctx.save();
  ctx.lineWidth = 3;
  ctx.lineJoin = "round";
  ctx.strokeStyle = colours.halo;
  const path = new Path2D(SHAPES[kind](x, y, r));
  ctx.lineWidth = 6;
  ctx.stroke(path);
  ctx.lineWidth = 3;
  ctx.strokeStyle = ctx.fillStyle = colours[kind];
  if (kind === "confirmed") ctx.fill(path);
  else if (kind === "coasting" || kind === "tentative") {
    ctx.fillStyle = colours.halo;
    ctx.fill(path);
  }
  ctx.stroke(path);
  ctx.restore();
}

/** @type {Record<string, (x: number, y: number, r: number) => string>} */
const SHAPES = {
  confirmed: (x, y, r) => `M${x} ${y - r}L${x + r} ${y + 0.8 * r}H${x - r}Z`,
  coasting: (x, y, r) => `M${x} ${y - r}L${x + r} ${y}L${x} ${y + r}L${x - r} ${y}Z`,
  tentative: (x, y, r) => `M${x - 0.8 * r} ${y}a${0.8 * r} ${0.8 * r} 0 1 1 ${1.6 * r} 0a${0.8 * r} ${0.8 * r} 0 1 1 ${-1.6 * r} 0Z`,
  dismissed: (x, y, r) => `M${x - 0.6 * r} ${y - 0.6 * r}l${1.2 * r} ${1.2 * r}m0 ${-1.2 * r}l${-1.2 * r} ${1.2 * r}`,
  not_a_fire: (x, y, r) =>
    `M${x - 0.8 * r} ${y}a${0.8 * r} ${0.8 * r} 0 1 1 ${1.6 * r} 0a${0.8 * r} ${0.8 * r} 0 1 1 ${-1.6 * r} 0ZM${x - 0.55 * r} ${y + 0.55 * r}l${1.1 * r} ${-1.1 * r}`,
};

/**
 * @param {Sheet} sheet @param {import("./store.js").Fire} fire @param {number | null} ageS @param {boolean} isChosen
 * @param {boolean} isNamed
 */
export function drawFire(sheet, fire, ageS, isChosen, isNamed) {
  if (fire.lat_deg === null || fire.lon_deg === null) return;
  const { ctx, colours } = sheet;
  const kind = kindOf(fire);
  const at = sheet.project(fire.lat_deg, fire.lon_deg);
  const strength = isChosen ? 1 : freshness(ageS);
  const isShown = kind === "confirmed" || kind === "coasting" || kind === "tentative";
  ctx.save();
  ctx.globalAlpha = strength;
  if (isShown) {
    ellipse(sheet, fire, fire.region95, [3, 5], 1.5, 0);
    ellipse(sheet, fire, fire.ellipse95, kind === "confirmed" ? [] : [10, 5], isChosen ? 4 : 2.5, isChosen ? 0.3 : 0.16);
    plume(sheet, fire, at);
  }
  if (isChosen) {
    ctx.beginPath();
    ctx.arc(at.x, at.y, 22, 0, 2 * Math.PI);
    ctx.strokeStyle = colours.ink;
    ctx.lineWidth = 3;
    ctx.stroke();
  }
  stamp(sheet, kind, at.x, at.y);
  if (isNamed || isChosen) label(sheet, nameOf(fire), at.x + 16, at.y - 12);
  ctx.restore();
}

/**
 * @param {Sheet} sheet @param {import("./store.js").Fire} fire @param {import("./store.js").Ellipse} shape
 * @param {number[]} dash @param {number} width @param {number} fill
 */
function ellipse(sheet, fire, shape, dash, width, fill) {
  const { semi_major_m: a, semi_minor_m: b, azimuth_deg: azimuth } = shape;
  if (a === null || b === null || azimuth === null || fire.lat_deg === null || fire.lon_deg === null) return;
  if (a > LARGEST_M) return; // nothing is known of where
  const { ctx, colours, project } = sheet;
  const at = project(fire.lat_deg, fire.lon_deg);
  const scale = pixelsAMetre(project, fire.lat_deg, fire.lon_deg);
  if (a * scale.x < HIDDEN_PX) return; // under its symbol
  ctx.save();
  ctx.translate(at.x, at.y);
  ctx.scale(scale.x, scale.y);
  ctx.rotate(((azimuth - 90) * Math.PI) / 180); // east is right, and y runs down
  ctx.beginPath();
  ctx.ellipse(0, 0, a, b, 0, 0, 2 * Math.PI);
  ctx.restore();
  ctx.save();
  ctx.fillStyle = ctx.strokeStyle = colours[kindOf(fire)];
  if (fill) {
    ctx.globalAlpha *= fill;
    ctx.fill();
    ctx.globalAlpha /= fill;
  }
  ctx.setLineDash(dash);
  ctx.lineWidth = width;
  ctx.stroke();
  ctx.restore();
}

/** @param {Project} project @param {number} lat @param {number} lon @returns {{x: number, y: number}} of east, of north */
export function pixelsAMetre(project, lat, lon) {
  const step = 0.01;
  const metres = metresADegree(lat);
  const [south, north] = [project(lat - step, lon), project(lat + step, lon)];
  const [west, east] = [project(lat, lon - step), project(lat, lon + step)];
  return { x: (east.x - west.x) / (2 * step * metres.east), y: (south.y - north.y) / (2 * step * metres.north) };
}

/** The smoke beside the fire: a dotted circle as wide as it is, and where it drifts to.
 * @param {Sheet} sheet @param {import("./store.js").Fire} fire @param {{x: number, y: number}} at */
function plume(sheet, fire, at) {
  const centre = fire.plume?.centre;
  if (!fire.plume || !centre || fire.lat_deg === null || fire.lon_deg === null) return;
  const { ctx, colours, project } = sheet;
  const to = project(centre[1], centre[0]);
  if (Math.hypot(to.x - at.x, to.y - at.y) < HIDDEN_PX) return;
  const radius = ((fire.plume.extent_m.width ?? 0) / 2) * pixelsAMetre(project, centre[1], centre[0]).x;
  ctx.save();
  ctx.strokeStyle = colours.smoke;
  ctx.lineWidth = 2;
  ctx.setLineDash([2, 4]);
  ctx.beginPath();
  ctx.arc(to.x, to.y, Math.max(radius, 4), 0, 2 * Math.PI);
  ctx.stroke();
  ctx.setLineDash([]);
  if (Math.hypot(to.x - at.x, to.y - at.y) > 12) arrow(ctx, at, to);
  ctx.restore();
}

/** @param {CanvasRenderingContext2D} ctx @param {{x: number, y: number}} a @param {{x: number, y: number}} b */
function arrow(ctx, a, b) {
  const turn = Math.atan2(b.y - a.y, b.x - a.x);
  ctx.beginPath();
  ctx.moveTo(a.x, a.y);
  ctx.lineTo(b.x, b.y);
  for (const side of [-0.5, 0.5]) {
    ctx.moveTo(b.x, b.y);
    ctx.lineTo(b.x - 9 * Math.cos(turn + side), b.y - 9 * Math.sin(turn + side));
  }
  ctx.stroke();
}

/** @param {Sheet} sheet @param {import("./store.js").Drone} drone @param {boolean} isLost */
export function drawDrone(sheet, drone, isLost) {
  const { ctx, colours, project } = sheet;
  ctx.save();
  ctx.globalAlpha = isLost ? 0.5 : 1;
  ctx.strokeStyle = ctx.fillStyle = colours.drone;
  if (!isLost && drone.footprint.length > 2) {
    trace(ctx, drone.footprint, project);
    ctx.closePath();
    ctx.globalAlpha = 0.08;
    ctx.fill();
    ctx.globalAlpha = 0.5;
    ctx.lineWidth = 1;
    ctx.stroke();
    ctx.globalAlpha = 1;
  }
  trace(ctx, drone.path, project);
  ctx.lineWidth = 2;
  ctx.stroke();
  if (drone.lat_deg !== null && drone.lon_deg !== null) {
    const at = project(drone.lat_deg, drone.lon_deg);
    ctx.save();
    ctx.translate(at.x, at.y);
    ctx.rotate(((drone.heading_deg ?? 0) * Math.PI) / 180);
    ctx.beginPath();
    ctx.moveTo(0, -14);
    ctx.lineTo(9, 10);
    ctx.lineTo(0, 5);
    ctx.lineTo(-9, 10);
    ctx.closePath();
    ctx.lineWidth = 4;
    ctx.strokeStyle = colours.halo;
    ctx.stroke();
    ctx.fill();
    ctx.restore();
    label(sheet, drone.name, at.x + 14, at.y + 18);
  }
  ctx.restore();
}

/** @param {CanvasRenderingContext2D} ctx @param {number[][]} points [lon, lat] @param {Project} project */
function trace(ctx, points, project) {
  ctx.beginPath();
  for (const [lon, lat] of points) {
    const at = project(lat, lon);
    ctx.lineTo(at.x, at.y);
  }
}

/** @param {Sheet} sheet @param {string} text @param {number} x @param {number} y */
export function label(sheet, text, x, y) {
  const { ctx, colours } = sheet;
  ctx.save();
  ctx.font = "600 14px system-ui, sans-serif";
  if (x + ctx.measureText(text).width > sheet.width - 4) {
    ctx.textAlign = "right"; // to the left of what it names
    x -= 32;
  }
  ctx.lineWidth = 4;
  ctx.lineJoin = "round";
  ctx.strokeStyle = colours.halo;
  ctx.strokeText(text, x, y);
  ctx.fillStyle = colours.ink;
  ctx.fillText(text, x, y);
  ctx.restore();
}

const STEPS_MINUTES = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120, 300, 600, 1800, 3600];
const LEAST_PX = 110;

/** Lines of latitude and longitude at round minutes, with their values at the edges.
 * @param {Sheet} sheet @param {{south: number, north: number, west: number, east: number}} bounds */
export function drawGrid(sheet, bounds) {
  const { ctx, colours, project, width, height } = sheet;
  ctx.save();
  ctx.strokeStyle = colours.grid;
  ctx.fillStyle = colours.faint;
  ctx.lineWidth = 1;
  ctx.font = "12px system-ui, sans-serif";
  const aDegree = width / Math.max(bounds.east - bounds.west, 1e-9);
  const step = STEPS_MINUTES.find((one) => (one / 60) * aDegree >= LEAST_PX) ?? 3600;
  const digits = step < 1 ? (step < 0.1 ? 2 : 1) : 0;
  for (const minute of between(bounds.west, bounds.east, step)) {
    const { x } = project(bounds.north, minute / 60);
    line(ctx, x, 0, x, height);
    ctx.fillText(gridText(minute, "E", "W", digits), x + 4, height - 6);
  }
  for (const minute of between(bounds.south, bounds.north, step)) {
    const { y } = project(minute / 60, bounds.west);
    line(ctx, 0, y, width, y);
    ctx.fillText(gridText(minute, "N", "S", digits), width - 84, y - 4);
  }
  ctx.restore();
}

/** @param {number} low degrees @param {number} high degrees @param {number} step minutes @returns {number[]} minutes */
function between(low, high, step) {
  const out = [];
  for (let one = Math.ceil((low * 60) / step); one <= (high * 60) / step && out.length < 60; one++) out.push(one * step);
  return out;
}

/** @param {number} minute @param {string} plus @param {string} minus @param {number} digits */
function gridText(minute, plus, minus, digits) {
  const whole = Math.abs(minute) + 1e-9;
  return `${Math.floor(whole / 60)}° ${(whole % 60).toFixed(digits)}' ${minute >= 0 ? plus : minus}`;
}

/** @param {CanvasRenderingContext2D} ctx @param {number} x1 @param {number} y1 @param {number} x2 @param {number} y2 */
function line(ctx, x1, y1, x2, y2) {
  ctx.beginPath();
  ctx.moveTo(Math.round(x1) + 0.5, Math.round(y1) + 0.5);
  ctx.lineTo(Math.round(x2) + 0.5, Math.round(y2) + 0.5);
  ctx.stroke();
}
