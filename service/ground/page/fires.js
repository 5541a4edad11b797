/** The table of fires, the most urgent first; a row is made once and then changed. */

import { byId, element, setText } from "./dom.js";
import { age, bearing, fromTo, metres, within } from "./geo.js";
import { kindOf, nameOf, WORDS } from "./store.js";
import { badge } from "./badge.js";
import { saidOf } from "./together.js";

const MOST_ROWS = 100;
const MOST_TWINS = 2;
const OLD_S = 120;

export class FireTable {
  /** @param {import("./store.js").Store} store @param {(id: string) => void} onPick */
  constructor(store, onPick) {
    this._store = store;
    this._onPick = onPick;
    this._body = /** @type {HTMLElement} */ (document.querySelector("#fires tbody"));
    /** @type {Map<string, HTMLElement>} */ this._rows = new Map();
  }

  /** @param {import("./geo.js").Place | null} own */
  show(own) {
    const fires = this._store.urgent();
    const shown = fires.slice(0, MOST_ROWS);
    byId("none").hidden = fires.length > 0;
    byId("fires").hidden = fires.length === 0;
    setText(byId("more"), fires.length > MOST_ROWS ? `${fires.length - MOST_ROWS} less urgent ones are on the map only.` : "");
    const wanted = new Set(shown.map((one) => one.id));
    for (const [id, row] of this._rows)
      if (!wanted.has(id)) {
        row.remove();
        this._rows.delete(id);
      }
    shown.forEach((fire, index) => {
      const row = this._rows.get(fire.id) ?? this._made(fire.id);
      this._fill(row, fire, own);
      if (this._body.children[index] !== row) this._body.insertBefore(row, this._body.children[index] ?? null);
    });
  }

  /** @param {string} id */
  _made(id) {
    const pick = () => this._onPick(id);
    const row = element(
      "tr",
      { "data-fire": id, onclick: pick },
      element("td", {}, element("button", { type: "button", class: "name" }), element("span", { class: "state" }),
        element("span", { class: "twins" })),
      element("td", { class: "place" }),
      element("td", { class: "size" }),
      element("td", { class: "seen" }),
    );
    this._rows.set(id, row);
    return row;
  }

  /** @param {HTMLElement} row @param {import("./store.js").Fire} fire @param {import("./geo.js").Place | null} own */
  _fill(row, fire, own) {
    const kind = kindOf(fire);
    const [first, place, size, seen] = row.children;
    const [name, state, twins] = first.children;
    setText(name, nameOf(fire));
    const isAcknowledged = fire.mark?.is_acknowledged ?? false;
    if (state.getAttribute("data-kind") !== `${kind} ${isAcknowledged}`) {
      state.setAttribute("data-kind", `${kind} ${isAcknowledged}`);
      state.replaceChildren(badge(kind), ` ${WORDS[kind]}${isAcknowledged ? ", seen by crew" : ""}`);
    }
    setText(twins, [saidOf(this._store, fire), mayBe(this._store.twinsOf(fire))].filter(Boolean).join("; "));
    row.dataset.state = kind;
    row.classList.toggle("news", kind === "confirmed" && !isAcknowledged);
    row.setAttribute("aria-selected", String(this._store.selected === fire.id));
    let where = fire.place ? fire.place.minutes.replace("  ", "\n") : "not known";
    if (own && fire.lat_deg !== null && fire.lon_deg !== null) {
      const told = fromTo(own, { lat: fire.lat_deg, lon: fire.lon_deg });
      where += `\n${metres(told.distance)} at ${bearing(told.bearing)}`;
    }
    setText(place, where);
    setText(size, within(fire.ellipse95));
    const ageS = this._store.ageS(fire);
    row.classList.toggle("old", ageS === null || ageS > OLD_S);
    setText(seen, ageS === null ? "unknown" : `${age(ageS)} ago`);
  }
}

/** @param {import("./store.js").Fire[]} twins @returns {string} that it may be one with them; empty where there are none */
export function mayBe(twins) {
  const names = twins.slice(0, MOST_TWINS).map(nameOf);
  const more = twins.length > MOST_TWINS ? ` and ${twins.length - MOST_TWINS} more` : "";
  return names.length ? `may be one with ${names.join(", ")}${more}` : "";
}
