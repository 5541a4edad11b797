/** One alert for each fire that becomes confirmed, until somebody has seen it. */

import { badge } from "./badge.js";
import { byId, element, setText } from "./dom.js";
import { within } from "./geo.js";
import { mayBe } from "./fires.js";
import { kindOf, nameOf } from "./store.js";

const MOST_SHOWN = 3;

export class Alerts {
  /** @param {(id: string) => void} onShow @param {(fire: import("./store.js").Fire) => void} onSeen */
  constructor(onShow, onSeen) {
    this._onShow = onShow;
    this._onSeen = onSeen;
    this.isLoud = false;
    this._root = byId("alerts");
    /** @type {Map<string, HTMLElement>} */ this._shown = new Map();
    /** @type {Set<string>} */ this._told = new Set();
  }

  /** @param {import("./store.js").Store} store what is so now, whatever the page shows */
  show(store) {
    for (const fire of store.urgent()) {
      const isDue = kindOf(fire) === "confirmed" && !fire.mark?.is_acknowledged;
      if (isDue && !this._told.has(fire.id)) this._tellOnce(fire, store);
      else if (isDue && this._shown.has(fire.id)) this._fill(fire, store);
      if (!isDue && this._shown.has(fire.id)) this._take(fire.id);
      if (!isDue && fire.mark?.is_acknowledged) this._told.delete(fire.id); // due again: somebody sees another one there
    }
    for (const id of [...this._shown.keys()]) if (store.fires.get(id)?.fused) this._take(id);
    for (const id of this._told)
      if (!store.fires.has(id)) {
        this._told.delete(id);
        this._take(id);
      }
  }

  /** What is fused of fires that were told of is no news; an alert of one of them goes on as its own.
   * @param {import("./store.js").Fire} fire @param {import("./store.js").Store} store */
  _tellOnce(fire, store) {
    const members = store.membersOf(fire);
    const own = members.map((one) => one.id);
    const isKnown = members.some((one) => this._told.has(one.id) && !one.mark?.is_acknowledged);
    const isShown = own.some((id) => this._shown.has(id));
    for (const id of [fire.id, ...own]) this._told.add(id);
    if (!isKnown || isShown) this._tell(fire, store, isKnown);
  }

  /** @param {import("./store.js").Fire} fire @param {import("./store.js").Store} store @param {boolean} isQuiet */
  _tell(fire, store, isQuiet) {
    if (this.isLoud && !isQuiet) beep();
    const { id } = fire;
    const take = () => this._take(id);
    const made = element(
      "div",
      { class: "alert", "data-fire": id },
      badge("confirmed"),
      element("a", { href: `#${encodeURIComponent(id)}`, onclick: () => this._onShow(id) }, ""),
      element("span", { class: "coordinate" }),
      element("span", { class: "size" }),
      element("button", { type: "button", onclick: () => { this._onSeen(store.fires.get(id) ?? fire); take(); } }, "Acknowledge"),
      element("button", { type: "button", class: "close", onclick: take }, "Hide"),
    );
    this._shown.set(id, made);
    this._fill(fire, store);
    this._root.prepend(made);
    for (const old of [...this._root.children].slice(MOST_SHOWN)) this._take(/** @type {HTMLElement} */ (old).dataset.fire ?? "");
    this._root.dataset.more = String(this._root.children.length - 1);
  }

  /** Its name and place as they are known now. @param {import("./store.js").Fire} fire @param {import("./store.js").Store} store */
  _fill(fire, store) {
    const made = this._shown.get(fire.id);
    const [name, where, size] = ["a", ".coordinate", ".size"].map((one) => made?.querySelector(one));
    if (name) setText(name, `Fire: ${nameOf(fire)}`);
    if (where) setText(where, fire.place?.minutes ?? "place not known");
    const twins = mayBe(store.twinsOf(fire));
    if (size) setText(size, `${within(fire.ellipse95)}${twins ? `; ${twins}` : ""}`);
  }

  /** @param {string} id */
  _take(id) {
    this._shown.get(id)?.remove();
    this._shown.delete(id);
    this._root.dataset.more = String(this._root.children.length - 1);
  }
}

/** Two short tones; made here, as no sound is fetched. */
function beep() {
  const audio = new AudioContext();
  for (const [start, pitch] of [[0, 880], [0.25, 660]]) {
    const tone = new OscillatorNode(audio, { frequency: pitch });
    const gain = new GainNode(audio, { gain: 0.2 });
    tone.connect(gain).connect(audio.destination);
    tone.start(audio.currentTime + start);
    tone.stop(audio.currentTime + start + 0.2);
  }
  setTimeout(() => audio.close(), 1000);
}
