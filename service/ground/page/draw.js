/** What the canvas over the map shows: drones and fires. Draws on a 2D context with a projection; knows no map. */

import { metresADegree } from "./geo.js";
import { kindOf, nameOf } from "./store.js";

/** @typedef {(lat: number, lon: number) => {x: number, y: number}} Project */
/** @typedef {{ctx: CanvasRenderingContext2D, project: Project, width: number, height: number,
 *   density: number, colours: Record<string, string>, taken: Box[]}} Sheet `taken`: where texts are already */
/** @typedef {{left: number, top: number, right: number, bottom: number}} Box */

const FRESH_S = 30;
const OLD_S = 900;
const LARGEST_M = 200000;
const HIDDEN_PX = 6;
const TWINS_NAMED_PX = 90;

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
  if (isNamed || isChosen) name(sheet, nameOf(fire), at.x, at.y);
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

/** A line between two that may be one fire. @param {Sheet} sheet @param {import("./store.js").Fire} a @param {import("./store.js").Fire} b */
export function drawTwins(sheet, a, b) {
  if (a.lat_deg === null || a.lon_deg === null || b.lat_deg === null || b.lon_deg === null) return;
  const { ctx, colours, project } = sheet;
  const [p, q] = [project(a.lat_deg, a.lon_deg), project(b.lat_deg, b.lon_deg)];
  const apart = Math.hypot(p.x - q.x, p.y - q.y);
  ctx.save();
  for (const [width, colour] of /** @type {[number, string][]} */ ([[5, colours.halo], [2, colours.ink]])) {
    ctx.lineWidth = width;
    ctx.strokeStyle = colour;
    ctx.setLineDash([6, 4]);
    ctx.beginPath();
    ctx.moveTo(p.x, p.y);
    ctx.lineTo(q.x, q.y);
    ctx.stroke();
  }
  if (apart > TWINS_NAMED_PX) label(sheet, "may be one", (p.x + q.x) / 2 + 6, (p.y + q.y) / 2 + 4);
  ctx.restore();
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
    name(sheet, drone.name, at.x, at.y);
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

const FONT = "600 14px system-ui, sans-serif";
const TEXT_PX = 16;

/** The name of what is at a place, beside it where no other text is. @param {Sheet} sheet @param {string} text
 * @param {number} x @param {number} y */
function name(sheet, text, x, y) {
  sheet.ctx.font = FONT;
  const wide = sheet.ctx.measureText(text).width;
  const ways = [[16, -12], [16, 20], [-16 - wide, -12], [-16 - wide, 20], [-wide / 2, -28], [-wide / 2, 38]];
  const boxes = ways.map(([right, down]) => boxOf(x + right, y + down, wide));
  const free = boxes.find((one) => one.left > 0 && one.right < sheet.width && !sheet.taken.some((other) => meet(one, other)));
  const box = free ?? boxes[x + 16 + wide < sheet.width ? 0 : 2];
  label(sheet, text, box.left, box.top + TEXT_PX - 4);
}

/** @param {number} x @param {number} y of its base line @param {number} wide @returns {Box} */
export function boxOf(x, y, wide) {
  return { left: x, top: y + 4 - TEXT_PX, right: x + wide, bottom: y + 4 };
}

/** @param {Box} a @param {Box} b */
function meet(a, b) {
  return a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
}

/** @param {Sheet} sheet @param {string} text @param {number} x @param {number} y */
export function label(sheet, text, x, y) {
  const { ctx, colours } = sheet;
  ctx.save();
  ctx.font = FONT;
  const wide = ctx.measureText(text).width;
  x = Math.max(4, Math.min(x, sheet.width - wide - 4));
  sheet.taken.push(boxOf(x, y, wide));
  ctx.lineWidth = 4;
  ctx.lineJoin = "round";
  ctx.strokeStyle = colours.halo;
  ctx.strokeText(text, x, y);
  ctx.fillStyle = colours.ink;
  ctx.fillText(text, x, y);
  ctx.restore();
}
