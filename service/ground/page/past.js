/** The time line: back to what was shown before, while the ground goes on telling. */

import { byId, setText } from "./dom.js";
import { clock } from "./geo.js";
import { Store } from "./store.js";

const END = 1000;

export class TimeLine {
  /** @param {import("./store.js").Store} store what is shown @param {() => void} onShow */
  constructor(store, onShow) {
    this._store = store;
    this._onShow = onShow;
    /** What the ground tells now, whatever is shown. */
    this.live = new Store();
    this._slider = /** @type {HTMLInputElement} */ (byId("when"));
    this._button = /** @type {HTMLButtonElement} */ (byId("live"));
    this._asked = 0;
    this._slider.addEventListener("input", () => this._ask());
    this._button.addEventListener("click", () => this.back());
    byId("past").addEventListener("submit", (event) => event.preventDefault());
  }

  /** News of the ground; shown unless the past is. @param {import("./store.js").News} news */
  take(news) {
    this.live.take(news);
    if (!this._store.isPast) this._store.take(news);
  }

  /** @returns {{begin: number, end: number} | null} */
  _span() {
    const begin = this.live.ground?.begin_s ?? null;
    return begin === null ? null : { begin, end: this.live.nowS() };
  }

  async _ask() {
    const span = this._span();
    const share = Number(this._slider.value) / END;
    if (!span || share >= 1) {
      this.back();
      return;
    }
    const asked = ++this._asked;
    const past = await toldAt(span.begin + share * (span.end - span.begin));
    if (asked !== this._asked) return;
    if (past === null) this._place();
    else {
      this._store.isPast = true;
      this._store.take(past);
    }
    this._say();
  }

  /** To what is so now, as far as the ground was heard: nothing is asked for, so that nothing can fail. */
  back() {
    this._asked++;
    if (this._store.isPast) {
      this._store.isPast = false;
      this._store.showAs(this.live);
    }
    this._place();
    this._say();
  }

  /** The slider where what is shown is; else it stays as it was set, as that is between two steps. */
  _place() {
    const span = this._span();
    const share = this._store.isPast && span ? (this._store.nowS() - span.begin) / Math.max(span.end - span.begin, 1) : 1;
    this._slider.value = String(Math.round(END * share));
  }

  /** What is shown, in button and words, to the eye and to a screen reader. */
  _say() {
    const { isPast } = this._store;
    if (!isPast && document.activeElement === this._button) this._slider.focus();
    this._button.hidden = !isPast;
    const text = isPast ? clock(this._store.nowS()) : "now";
    setText(byId("asof"), text);
    this._slider.setAttribute("aria-valuetext", text);
    this._onShow();
  }
}

/** @param {number} time @returns {Promise<import("./store.js").News | null>} null where the ground does not say */
async function toldAt(time) {
  try {
    const answer = await fetch(`past?t=${time}`);
    return answer.ok ? await answer.json() : null;
  } catch {
    return null; // not reached: the page says so beside
  }
}
