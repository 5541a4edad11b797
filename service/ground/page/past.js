/** The time line: back to what was shown before, while the ground goes on telling. */

import { byId, setText } from "./dom.js";
import { clock } from "./geo.js";

const END = 1000;

export class TimeLine {
  /** @param {import("./store.js").Store} store @param {() => void} onShow */
  constructor(store, onShow) {
    this._store = store;
    this._onShow = onShow;
    this._slider = /** @type {HTMLInputElement} */ (byId("when"));
    this._live = /** @type {HTMLButtonElement} */ (byId("live"));
    /** @type {import("./store.js").News | null} */ this._latest = null;
    this._asked = 0;
    this._slider.addEventListener("input", () => this._ask());
    this._live.addEventListener("click", () => this._back());
    byId("past").addEventListener("submit", (event) => event.preventDefault());
  }

  /** News of the ground; while the past is shown it is only noted that there is some. @param {import("./store.js").News} news */
  take(news) {
    this._latest = news;
    if (!this._store.isPast) this._store.take(news);
  }

  /** @returns {{begin: number, end: number} | null} */
  _span() {
    const begin = this._latest?.ground.begin_s ?? null;
    return begin === null || !this._latest ? null : { begin, end: this._latest.now_s };
  }

  async _ask() {
    const span = this._span();
    const share = Number(this._slider.value) / END;
    if (!span || share >= 1) {
      this._back();
      return;
    }
    const time = span.begin + share * (span.end - span.begin);
    const asked = ++this._asked;
    const answer = await fetch(`past?t=${time}`);
    if (!answer.ok || asked !== this._asked) return;
    this._store.isPast = true;
    this._store.take(await answer.json());
    this._live.hidden = false;
    this._say(clock(this._store.nowS()));
    this._onShow();
  }

  /** To the eye and to a screen reader. @param {string} text */
  _say(text) {
    setText(byId("asof"), text);
    this._slider.setAttribute("aria-valuetext", text);
  }

  async _back() {
    this._asked++;
    this._slider.value = String(END);
    if (document.activeElement === this._live) this._slider.focus();
    this._live.hidden = true;
    this._say("now");
    if (!this._store.isPast) return;
    const answer = await fetch("past?t=now");
    if (answer.ok) this._store.take(await answer.json());
    this._store.isPast = false;
    this._onShow();
  }
}
