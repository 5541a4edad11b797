/** The drones: who is there, and in words what does not work as it should and how to mend it. */

import { badge } from "./badge.js";
import { byId, element } from "./dom.js";
import { age } from "./geo.js";

const LOST_S = 10;
const CLOCK_OFF_S = 3;
/** @type {Record<string, {meaning: string, mend: string}>} */
let meanings = {};

/** The ground's table of what a name in `degraded` means. */
export async function loadMeanings() {
  meanings = await (await fetch("meanings")).json();
}

/** @param {string[]} names @returns {HTMLElement} */
export function inWords(names) {
  return element(
    "ul",
    { class: "words" },
    ...names.map((name) => {
      const told = meanings[name];
      if (!told) return element("li", {}, name);
      return element("li", {}, `${capital(told.meaning)}. `, element("em", {}, `${capital(told.mend)}.`));
    }),
  );
}

export class DroneList {
  /** @param {import("./store.js").Store} store */
  constructor(store) {
    this._store = store;
    this._root = byId("drones");
    /** @type {Map<string, {made: HTMLElement, said: string}>} */ this._items = new Map();
  }

  show() {
    for (const [name, { made }] of this._items)
      if (!this._store.drones.has(name)) {
        made.remove();
        this._items.delete(name);
      }
    for (const drone of this._store.drones.values()) this._showOne(drone);
  }

  /** @param {import("./store.js").Drone} drone */
  _showOne(drone) {
    const quietS = this._store.quietS(drone);
    const head = headOf(drone, quietS);
    const faults = faultsOf(drone);
    const said = JSON.stringify([head, faults, drone.degraded, drone.says]);
    const item = this._items.get(drone.name) ?? { made: element("li"), said: "" };
    if (item.said === said) return;
    item.said = said;
    item.made.replaceChildren(
      badge("drone"),
      element("strong", {}, drone.name),
      ` ${head}`,
      ...(drone.degraded.length ? [inWords(drone.degraded)] : []),
      ...faults.map((one) => element("p", { class: "fault" }, one)),
      ...(drone.says.length ? [why(drone.says)] : []),
    );
    if (!this._items.has(drone.name)) {
      this._items.set(drone.name, item);
      this._root.append(item.made);
    }
  }
}

/** @param {string[]} says */
function why(says) {
  return element("details", {}, element("summary", {}, "What it sees, and what that lacks"),
    element("ul", {}, ...says.map((one) => element("li", {}, one))));
}

/** @param {import("./store.js").Drone} drone @param {number} quietS */
function headOf(drone, quietS) {
  if (drone.is_alive === false) return "is gone: nothing new of its fires";
  if (quietS > LOST_S) return `has not been heard for ${Number.isFinite(quietS) ? age(quietS) : "an unknown time"}`;
  if (drone.state === "ok") return "is well";
  return drone.state ? `is ${drone.state}` : "is there";
}

/** @param {import("./store.js").Drone} drone @returns {string[]} */
function faultsOf(drone) {
  const out = [];
  if (drone.is_twice) out.push("Two drones call themselves so: their fires are mixed. Give one another name (vehicle in its config).");
  const behind = drone.clock_behind_s ?? 0;
  if (Math.abs(behind) > CLOCK_OFF_S && drone.may_be_delay)
    out.push(`Its messages come ${age(behind)} late, or its clock is that far behind: ages are by its own times, none is too fresh. Is the link slow?`);
  else if (Math.abs(behind) > CLOCK_OFF_S)
    out.push(`Its clock is ${age(Math.abs(behind))} ${behind > 0 ? "behind" : "ahead"}; its times are shown by the ground's.`);
  for (const [reason, count] of Object.entries(drone.refused)) out.push(`${count} messages were refused: ${reason}.`);
  return out;
}

/** @param {string} text */
function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
