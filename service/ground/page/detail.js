/** One fire in full: its place four ways, how sure, what people said of it, and the picture that shows it. */

import { badge } from "./badge.js";
import { byId, element, setText } from "./dom.js";
import { freshness } from "./draw.js";
import { age, bearing, clock, fromTo, metres, within } from "./geo.js";
import { kindOf, nameOf, WORDS } from "./store.js";
import { factsOf } from "./together.js";

const NAME_CHARACTERS = 40;
const AHEAD_S = 60;
/** @type {Record<string, string>} */
const MOTION = {
  fixed: "stands still",
  unresolved: "may be moving: not yet known",
  moving: "moves: no fire on the ground does",
};

export class Detail {
  /**
   * @param {import("./store.js").Store} store @param {(id: string | null) => void} onPick
   * @param {(fire: import("./store.js").Fire, change: object) => void} onMark @param {(names: string[]) => HTMLElement} inWords
   */
  constructor(store, onPick, onMark, inWords) {
    this._store = store;
    this._onMark = onMark;
    this._inWords = inWords;
    this._root = byId("detail");
    /** @type {string | null} */ this._shown = null;
    /** @type {Record<string, HTMLElement>} */ this._parts = {};
    this._close = () => onPick(null);
    this._pick = onPick;
  }

  /** @param {import("./geo.js").Place | null} own */
  show(own) {
    const fire = this._store.fires.get(this._store.selected ?? "");
    this._root.hidden = fire === undefined;
    if (!fire) {
      this._shown = null;
      return;
    }
    if (this._shown !== fire.id) this._build(fire);
    this._fill(fire, own);
  }

  /** @param {import("./store.js").Fire} fire */
  _build(fire) {
    this._shown = fire.id;
    const part = (/** @type {string} */ name, tag = "p", attributes = {}) =>
      (this._parts[name] = element(tag, { class: name, ...attributes }));
    const copies = ["minutes", "decimal", "mgrs", "utm"].map((kind) => this._copy(kind));
    const rename = /** @type {HTMLInputElement} */ (
      element("input", { type: "text", id: "fire-name", maxlength: String(NAME_CHARACTERS), autocomplete: "off" })
    );
    rename.value = fire.mark?.name ?? "";
    const named = element("form", { class: "named" }, element("label", { for: "fire-name" }, "Name"), rename,
      element("button", { type: "submit" }, "Keep"));
    named.addEventListener("submit", (event) => {
      event.preventDefault();
      this._mark({ name: rename.value.trim() });
    });
    this._root.replaceChildren(
      element("div", { class: "head" }, part("title", "h2"),
        element("button", { type: "button", class: "close", onclick: this._close, title: "Close (Escape)" }, "Close")),
      part("state"),
      part("members"),
      part("twins"),
      ...copies,
      element("div", { class: "acts" },
        part("seen-by", "button", { type: "button", onclick: () => this._turn("is_acknowledged") }),
        part("verdict", "button", { type: "button", onclick: () => this._turn("verdict") })),
      part("said"),
      part("facts", "dl"),
      part("degraded", "div"),
      named,
      part("preview", "figure"),
    );
  }

  /** @param {string} kind */
  _copy(kind) {
    const names = { minutes: "Degrees and minutes", decimal: "Decimal", mgrs: "MGRS", utm: "UTM" };
    const value = (this._parts[kind] = element("span", { class: `coordinate ${kind}` }));
    const said = element("span", { role: "status", class: "copied" });
    const button = element("button", { type: "button", class: "copy", "data-copy": kind }, "Copy");
    button.setAttribute("aria-label", `Copy ${names[/** @type {"mgrs"} */ (kind)]}`);
    button.addEventListener("click", async () => {
      setText(said, (await copied(this._store.fires.get(this._shown ?? "")?.place?.[/** @type {"mgrs"} */ (kind)] ?? "")) ? "Copied" : "Select it and copy");
      setTimeout(() => setText(said, ""), 2000);
    });
    return element("p", { class: `copyable of-${kind}` }, element("span", { class: "quiet" }, names[/** @type {"mgrs"} */ (kind)]),
      value, button, said);
  }

  /** @param {import("./store.js").Fire} fire @param {import("./geo.js").Place | null} own */
  _fill(fire, own) {
    const kind = kindOf(fire);
    const parts = this._parts;
    setText(parts.title, nameOf(fire));
    if (parts.state.dataset.kind !== kind) {
      parts.state.dataset.kind = kind;
      parts.state.replaceChildren(badge(kind), ` ${WORDS[kind]}`);
    }
    for (const one of ["minutes", "decimal", "mgrs", "utm"]) {
      const text = fire.place?.[/** @type {"mgrs"} */ (one)] || "not known here";
      if (parts[one].dataset.said === text) continue;
      parts[one].dataset.said = text;
      const halves = one === "minutes" ? text.split("  ") : [text]; // a line breaks between them alone
      parts[one].replaceChildren(...halves.flatMap((half, index) => (index ? [" ", element("span", {}, half)] : [element("span", {}, half)])));
    }
    this._members(fire);
    this._twins(fire);
    setText(parts["seen-by"], fire.mark?.is_acknowledged ? "Seen by crew: undo" : "Acknowledge");
    setText(parts.verdict, fire.mark?.verdict ? "It is a fire after all" : "Not a fire");
    parts.said.hidden = !fire.mark;
    setText(parts.said, this._said(fire.mark));
    this._facts(this._factsOf(fire, own));
    const words = fire.degraded.join();
    if (parts.degraded.dataset.names !== words) {
      parts.degraded.dataset.names = words;
      parts.degraded.replaceChildren(...(fire.degraded.length ? [this._inWords(fire.degraded)] : []));
    }
    this._preview(fire);
  }

  /** When and where the crew's last word on it was said. @param {import("./store.js").Mark | null} mark */
  _said(mark) {
    if (!mark) return "";
    const ageS = this._store.nowS() - mark.time_s;
    const when = ageS < -AHEAD_S ? "at a time that is not known: a ground's clock is ahead" : `${age(ageS)} ago, at ${clock(mark.time_s)}`;
    return `${mark.verdict ? "Not a fire, as was said" : "Marked"}${mark.ground ? ` on ${mark.ground}` : ""} ${when}`;
  }

  /** What a fused fire is made of, or which one this is part of, each to be looked at. @param {import("./store.js").Fire} fire */
  _members(fire) {
    const whole = this._store.fires.get(fire.fused);
    const others = whole ? [whole] : this._store.membersOf(fire);
    const part = this._parts.members;
    const said = JSON.stringify(others.map((one) => [one.id, nameOf(one)]));
    if (part.dataset.said === said) return;
    part.dataset.said = said;
    part.hidden = others.length === 0;
    const links = others.map((one) =>
      element("a", { href: `#${encodeURIComponent(one.id)}`, onclick: () => this._pick(one.id) }, nameOf(one)));
    part.replaceChildren(whole ? "Part of " : "One fire, fused of ", ...links.flatMap((one, index) => (index ? [", ", one] : [one])));
  }

  /** Those of other drones that may be the same, each to be looked at. @param {import("./store.js").Fire} fire */
  _twins(fire) {
    const twins = this._store.twinsOf(fire);
    const part = this._parts.twins;
    const said = JSON.stringify(twins.map((one) => [one.id, nameOf(one)]));
    if (part.dataset.said === said) return;
    part.dataset.said = said;
    part.hidden = twins.length === 0;
    const links = twins.map((one) =>
      element("a", { href: `#${encodeURIComponent(one.id)}`, onclick: () => this._pick(one.id) }, nameOf(one)));
    part.replaceChildren("May be one fire with ", ...links.flatMap((one, index) => (index ? [", ", one] : [one])),
      ": their 95\u00a0% ellipses overlap.");
  }

  /** @param {[string, string][]} facts */
  _facts(facts) {
    const list = this._parts.facts;
    const names = facts.map(([name]) => name).join();
    if (list.dataset.names !== names) {
      list.dataset.names = names;
      list.replaceChildren(...facts.flatMap(([name]) => [element("dt", {}, name), element("dd")]));
    }
    facts.forEach(([, value], index) => setText(list.children[2 * index + 1], value));
  }

  /**
   * @param {import("./store.js").Fire} fire @param {import("./geo.js").Place | null} own
   * @returns {[string, string][]}
   */
  _factsOf(fire, own) {
    const ageS = this._store.ageS(fire);
    /** @type {[string, string][]} */
    const facts = [
      ["Last seen", ageS === null ? "time not known" : `${age(ageS)} ago, at ${clock(fire.seen_s)}`],
      ["Fire within, 95\u00a0%", shape(fire.ellipse95)],
      ["Smoke too, within", shape(fire.region95)],
    ];
    if (!fire.made_of) facts.push(["From the drone", `${metres(fire.range_m)} at ${bearing(fire.bearing_deg)}`]);
    facts.push(...factsOf(this._store, fire));
    if (own && fire.lat_deg !== null && fire.lon_deg !== null) {
      const told = fromTo(own, { lat: fire.lat_deg, lon: fire.lon_deg });
      facts.push(["From own place", `${metres(told.distance)} at ${bearing(told.bearing)}`]);
    }
    const height = fire.altitude_msl_m === null ? "unknown" : `${Math.round(fire.altitude_msl_m)} m over the sea`;
    facts.push(["Height", fire.vertical95_m === null ? height : `${height}, ± ${Math.round(fire.vertical95_m)} m`]);
    if (fire.plume) {
      facts.push(["Smoke", `${metres(fire.extent_m.width)} wide, ${metres(fire.extent_m.height)} high, ` +
        `drifts to ${bearing(fire.plume.drift_deg)}`]);
    }
    facts.push(
      ...(fire.advice ? [/** @type {[string, string]} */ (["To be surer", `${fire.made_of ? `${fire.made_of.surest.split("/")[0]}: ` : ""}${wayOf(fire.advice)}`])] : []),
      ["Motion", MOTION[fire.motion] ?? fire.motion],
      ["Sightings", `${fire.observations}, missed ${fire.misses}; a real thing with ${percent(fire.existence)}`],
    );
    if (!fire.made_of) facts.push(
      ["Heading by", fire.attitude === "scenery" ? `the scenery, ± ${fire.heading_sigma_deg ?? "?"}°` : "the autopilot"],
      ["Says", `${fire.vehicle}, its no. ${fire.target}, since ${clock(fire.first_s)}`],
    );
    return facts;
  }

  /** @param {import("./store.js").Fire} fire */
  _preview(fire) {
    const stamp = fire.preview_s ?? this._store.drones.get(fire.vehicle)?.preview_s ?? null;
    const figure = this._parts.preview;
    figure.hidden = stamp === null || this._store.isPast;
    if (figure.hidden || stamp === null) return;
    if (figure.dataset.stamp !== String(stamp)) {
      figure.dataset.stamp = String(stamp);
      const asked = fire.preview_s === null ? `vehicle=${encodeURIComponent(fire.vehicle)}` : `fire=${encodeURIComponent(fire.id)}`;
      const alt = `What ${fire.vehicle}'s camera saw, with what was found drawn in`;
      figure.replaceChildren(element("img", { src: `preview?${asked}&t=${stamp}`, alt }), element("figcaption"));
    }
    const ageS = this._store.nowS() - stamp;
    const what = fire.preview_s === null ? "the fire was not in it" : "the last one with this fire in view";
    setText(figure.children[1], `${fire.vehicle}'s camera at ${clock(stamp)}, ${age(ageS)} ago: ${what}`);
    figure.style.setProperty("--age", String(1 - freshness(ageS)));
  }

  /** @param {"is_acknowledged" | "verdict"} what */
  _turn(what) {
    const mark = this._store.fires.get(this._shown ?? "")?.mark;
    if (what === "verdict") this._mark({ verdict: mark?.verdict ? "" : "not_a_fire" });
    else this._mark({ is_acknowledged: !mark?.is_acknowledged });
  }

  /** @param {object} change */
  _mark(change) {
    const fire = this._store.fires.get(this._shown ?? "");
    if (fire) this._onMark(fire, change);
  }
}

/** @param {import("./store.js").Fire} fire @param {object} change @returns {object} as the ground takes it */
export function marked(fire, change) {
  const { is_acknowledged = false, name = "", verdict = "" } = fire.mark ?? {};
  const { vehicle, target, first_drone_s } = fire;
  return { vehicle, target, first_drone_s, time_s: 0, is_acknowledged, name, verdict, ...change };
}

/** @param {import("./store.js").Advice} advice @returns {string} */
function wayOf(advice) {
  const way = advice.kind === "arc" ? "begin an arc about it at" : "fly";
  const gain = advice.half_length_m === null ? "" : `, for ± ${metres(advice.half_length_m)}`;
  const seconds = advice.seconds === null ? "" : ` (${Math.round(advice.seconds)} s)`;
  return `${way} ${bearing(advice.heading_deg)}, ${metres(advice.length_m)}${seconds}${gain}`;
}

/** @param {import("./store.js").Ellipse} one */
function shape(one) {
  return `${within(one)}, the long way ${bearing(one.azimuth_deg)}`;
}

/** @param {number | null} share */
function percent(share) {
  return share === null ? "unknown odds" : `${Math.round(100 * share)}\u00a0%`;
}

/** @param {string} text @returns {Promise<boolean>} whether the browser let it */
async function copied(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false;
  }
}
