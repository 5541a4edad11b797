/** Lines of latitude and longitude on the canvas over the map. */

import { boxOf } from "./draw.js";

/** @typedef {import("./draw.js").Sheet} Sheet */

const STEPS_MINUTES = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120, 300, 600, 1800, 3600];
const LEAST_PX = 110;
const CORNER_PX = 70; // of the scale's and the legend's

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
    if (x > CORNER_PX && x < width - CORNER_PX) text(sheet, gridText(minute, "E", "W", digits), x + 4, height - 6);
  }
  for (const minute of between(bounds.south, bounds.north, step)) {
    const { y } = project(minute / 60, bounds.west);
    line(ctx, 0, y, width, y);
    if (y > 60) text(sheet, gridText(minute, "N", "S", digits), width - 84, y - 4);
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

/** @param {Sheet} sheet @param {string} words @param {number} x @param {number} y */
function text(sheet, words, x, y) {
  sheet.ctx.fillText(words, x, y);
  sheet.taken.push(boxOf(x, y, sheet.ctx.measureText(words).width));
}
