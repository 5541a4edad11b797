/** What several tell of: fused fires and who is outvoted, fire fronts, towers and their sectors; in words and on the map. */

import { byId, element, setText } from "./dom.js";
import { label, pixelsAMetre } from "./draw.js";
import { age, metres } from "./geo.js";
import { kindOf, nameOf } from "./store.js";

/** @typedef {import("./store.js").Fire} Fire */
/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./draw.js").Sheet} Sheet */

const SECTOR_M = 40000;
const OLD_S = 300;

/** Who tells of a fused fire, and whom they outvote; or by whom one is outvoted. @param {Store} store @param {Fire} fire */
export function saidOf(store, fire) {
  const by = store.fires.get(fire.outvoted_by);
  const word = by?.made_of?.outvoted.find((one) => one.id === fire.id);
  if (word) return `outvoted: others put it ${metres(word.away_m)} away`;
  if (!fire.made_of) return "";
  const { contributors, towers, outvoted } = fire.made_of;
  const drones = contributors.flatMap((id) => store.fires.get(id)?.vehicle ?? []);
  const words = [`by ${[...new Set(drones), ...towers].join(", ")}`];
  if (outvoted.length) words.push(`outvoted: ${outvoted.map((one) => one.vehicle).join(", ")}`);
  return words.join("; ");
}

/** The same at length. @param {Store} store @param {Fire} fire @returns {[string, string][]} */
export function factsOf(store, fire) {
  const others = store.fires.get(fire.outvoted_by);
  if (others) return [["Outvoted", `${nameOf(others)} ${away(others, fire)}: check ${fire.vehicle}'s compass and mount`]];
  if (!fire.made_of) return [];
  const { outvoted, towers, undecided, larger } = fire.made_of;
  /** @type {[string, string][]} */ const facts = [];
  if (towers.length) facts.push(["Towers", towers.join(", ")]);
  if (undecided.length) facts.push(["Perhaps also", `${undecided.join(", ")}: fits another fire as well, not counted`]);
  for (const one of outvoted) {
    facts.push(["Outvoted", `${one.vehicle} (${one.id}) puts it ${metres(one.away_m)} away, ${one.sigmas} times what it says it may err: check its compass and mount`]);
  }
  if (larger > 2) facts.push(["They disagree", `more than they say they err: the ellipse is ${Math.sqrt(larger).toFixed(1)} times as long for that`]);
  return facts;
}

/** @param {Fire} others @param {Fire} fire */
function away(others, fire) {
  const word = others.made_of?.outvoted.find((one) => one.id === fire.id);
  return word ? `is where several others put it, ${metres(word.away_m)} away` : "is where several others put it";
}

/** A drone's own ellipse under the fused one, faint. @param {Sheet} sheet @param {Fire} fire */
export function drawMember(sheet, fire) {
  const { semi_major_m: a, semi_minor_m: b, azimuth_deg: azimuth } = fire.ellipse95;
  if (a === null || b === null || azimuth === null || fire.lat_deg === null || fire.lon_deg === null || a > SECTOR_M) return;
  const { ctx, colours, project } = sheet;
  const at = project(fire.lat_deg, fire.lon_deg);
  const scale = pixelsAMetre(project, fire.lat_deg, fire.lon_deg);
  ctx.save();
  ctx.translate(at.x, at.y);
  ctx.scale(scale.x, scale.y);
  ctx.rotate(((azimuth - 90) * Math.PI) / 180);
  ctx.beginPath();
  ctx.ellipse(0, 0, a, b, 0, 0, 2 * Math.PI);
  ctx.restore();
  ctx.save();
  ctx.strokeStyle = colours[kindOf(fire)];
  ctx.globalAlpha = 0.55;
  ctx.lineWidth = 1.2;
  ctx.setLineDash([2, 3]);
  ctx.stroke();
  ctx.restore();
  label(sheet, fire.vehicle, at.x + 4, at.y + 14);
}

/** From who is outvoted to the fire that others have. @param {Sheet} sheet @param {Fire} fire @param {Fire} by */
export function drawOutvoted(sheet, fire, by) {
  if (fire.lat_deg === null || fire.lon_deg === null || by.lat_deg === null || by.lon_deg === null) return;
  const [p, q] = [sheet.project(fire.lat_deg, fire.lon_deg), sheet.project(by.lat_deg, by.lon_deg)];
  const { ctx, colours } = sheet;
  ctx.save();
  ctx.strokeStyle = colours.ink;
  ctx.lineWidth = 1.5;
  ctx.setLineDash([2, 5]);
  trace(ctx, [p, q]);
  ctx.stroke();
  ctx.restore();
}

/** @param {Sheet} sheet @param {import("./store.js").Front} front */
export function drawFront(sheet, front) {
  const { ctx, colours, project } = sheet;
  ctx.save();
  trace(ctx, front.points.map(([lon, lat]) => project(lat, lon)));
  ctx.strokeStyle = ctx.fillStyle = colours.confirmed;
  ctx.lineJoin = ctx.lineCap = "round";
  if (front.kind === "area") {
    ctx.closePath();
    ctx.globalAlpha = 0.15;
    ctx.fill();
  }
  ctx.globalAlpha = 0.45;
  ctx.lineWidth = 8;
  ctx.stroke();
  ctx.restore();
}

/** A tower with what it sees, each as a wedge that fades with age. @param {Sheet} sheet
 * @param {import("./store.js").Tower} tower @param {number} nowS */
export function drawTower(sheet, tower, nowS) {
  const { ctx, colours, project } = sheet;
  const at = project(tower.lat_deg, tower.lon_deg);
  const scale = pixelsAMetre(project, tower.lat_deg, tower.lon_deg);
  ctx.save();
  ctx.fillStyle = ctx.strokeStyle = colours.drone;
  for (const one of tower.sectors) {
    const [left, right] = [-0.5, 0.5].map((side) => ((one.azimuth_deg + side * one.opening_deg) * Math.PI) / 180);
    const edge = (/** @type {number} */ azimuth) => ({
      x: at.x + SECTOR_M * scale.x * Math.sin(azimuth), y: at.y - SECTOR_M * scale.y * Math.cos(azimuth) });
    trace(ctx, [at, edge(left), edge(right)]);
    ctx.closePath();
    const isOld = nowS - one.told_s > OLD_S;
    ctx.globalAlpha = isOld ? 0.06 : 0.14;
    ctx.fill();
    ctx.globalAlpha = isOld ? 0.3 : 0.6;
    ctx.lineWidth = 1;
    ctx.setLineDash(one.fire ? [] : [6, 5]);
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
  ctx.setLineDash([]);
  ctx.lineWidth = 3;
  ctx.strokeStyle = colours.halo;
  ctx.strokeRect(at.x - 6, at.y - 6, 12, 12);
  ctx.fillRect(at.x - 6, at.y - 6, 12, 12);
  ctx.restore();
  label(sheet, tower.name, at.x + 12, at.y + 5);
}

/** @param {CanvasRenderingContext2D} ctx @param {{x: number, y: number}[]} points */
function trace(ctx, points) {
  ctx.beginPath();
  for (const one of points) ctx.lineTo(one.x, one.y);
}

/** The towers in words. @param {Store} store */
export function showTowers(store) {
  const refused = Object.entries(store.ground?.alerts_refused ?? {});
  byId("of-towers").hidden = store.towers.length === 0 && refused.length === 0;
  const said = store.towers.map((one) => [one.name, wordsOf(one, store.nowS())]);
  for (const [reason, count] of refused) said.push([`${count} alerts refused`, reason]);
  const list = byId("towers");
  if (list.dataset.names !== said.map(([name]) => name).join()) {
    list.dataset.names = said.map(([name]) => name).join();
    list.replaceChildren(...said.map(([name]) => element("li", {}, element("strong", {}, name), element("span"))));
  }
  said.forEach(([, text], index) => setText(/** @type {HTMLElement} */ (list.children[index].lastElementChild), `: ${text}`));
}

/** @param {import("./store.js").Tower} tower @param {number} nowS */
function wordsOf(tower, nowS) {
  const sees = tower.sectors.map((one) => `${Math.round(one.azimuth_deg)}\u00b0 ${age(Math.max(0, nowS - one.told_s))} ago`);
  let text = `smoke at ${sees.join(", ")}`;
  if (tower.error_deg !== null && tower.fires)
    text += `; its azimuths are ${Math.abs(tower.error_deg)}\u00b0 too ${tower.error_deg < 0 ? "small" : "large"}, \u00b1 ${tower.error_sigma_deg}\u00b0, by ${tower.fires} ${tower.fires > 1 ? "fires" : "fire"}`;
  return text;
}
