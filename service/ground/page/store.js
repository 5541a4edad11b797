/** What the ground told, kept for the page. Knows no screen: `Store` is told news and tells its listeners. */

/** @typedef {{minutes: string, decimal: string, mgrs: string, utm: string}} Texts */
/** @typedef {{semi_major_m: number | null, semi_minor_m: number | null, azimuth_deg: number | null}} Ellipse */
/** @typedef {{is_acknowledged: boolean, name: string, verdict: string,
 *   time_s: number, ground: string}} Mark */
/** @typedef {{centre: number[] | null, altitude_msl_m: number | null, lean_deg: number | null, drift_deg: number | null,
 *   extent_m: {width: number | null, height: number | null}}} Plume */
/** @typedef {{kind: string, heading_deg: number | null, length_m: number | null, seconds: number | null,
 *   half_length_m: number | null}} Advice */
/** @typedef {{id: string, vehicle: string, target: number, epoch: number, state: string, aim: string,
 *   lat_deg: number | null, lon_deg: number | null, place: Texts | null, altitude_msl_m: number | null,
 *   ellipse95: Ellipse, region95: Ellipse, vertical95_m: number | null,
 *   extent_m: {width: number | null, height: number | null}, plume: Plume | null, range_m: number | null,
 *   bearing_deg: number | null, existence: number | null, observations: number, misses: number,
 *   baseline_m: number | null, attitude: string, heading_sigma_deg: number | null, motion: string, degraded: string[],
 *   advice: Advice | null,
 *   told_s: number | null, seen_s: number | null, first_s: number | null, mark: Mark | null,
 *   may_be: string[], preview_s: number | null, first_drone_s: number | null, is_earlier: boolean,
 *   fused: string, outvoted_by: string, made_of: Fused | null}} Fire `fused`: the id of the fire that it is part of */
/** @typedef {{contributors: string[], surest: string, undecided: string[], towers: string[], larger: number,
 *   outvoted: {id: string, vehicle: string, away_m: number, sigmas: number}[]}} Fused */
/** @typedef {{kind: string, fires: string[], points: number[][]}} Front */
/** @typedef {{name: string, lat_deg: number, lon_deg: number, altitude_msl_m: number | null, error_deg: number | null,
 *   error_sigma_deg: number | null, fires: number,
 *   sectors: {azimuth_deg: number, opening_deg: number, told_s: number, fire: string}[]}} Tower */
/** @typedef {{name: string, is_alive: boolean | null, heard_s: number, clock_behind_s: number | null, may_be_delay: boolean, state: string,
 *   degraded: string[], says: string[], lat_deg: number | null, lon_deg: number | null, altitude_msl_m: number | null,
 *   heading_deg: number | null, footprint: number[][], path: number[][], preview_s: number | null,
 *   refused: Record<string, number>, is_twice: boolean}} Drone */
/** @typedef {{links: Record<string, boolean>, recorded_s: number | null, record_fault: string, record_lost: number,
 *   replay: string,
 *   begin_s: number | null, left_out: number, alerts_refused: Record<string, number>}} Ground */
/** @typedef {{kind: string, now_s: number, fires: Fire[], drones: Drone[], gone_fires: string[],
 *   gone_drones: string[], towers: Tower[], fronts: Front[], ground: Ground}} News */

const AHEAD_S = 5; // what is later than now by more has no age that could be told
const ORDER = ["confirmed", "coasting", "tentative", "dismissed"];

export class Store {
  constructor() {
    /** @type {Map<string, Fire>} */ this.fires = new Map();
    /** @type {Map<string, Drone>} */ this.drones = new Map();
    /** @type {Tower[]} */ this.towers = [];
    /** @type {Front[]} */ this.fronts = [];
    /** @type {Ground | null} */ this.ground = null;
    /** @type {string | null} */ this.selected = null;
    this.isPast = false;
    /** @type {Fire[] | null} */ this._urgent = null;
    this._nowS = 0;
    this._at = 0;
  }

  /** @param {News} news */
  take(news) {
    if (news.kind === "all") {
      this.fires = new Map(news.fires.map((one) => [one.id, one]));
      this.drones = new Map(news.drones.map((one) => [one.name, one]));
    } else {
      for (const one of news.fires) this.fires.set(one.id, one);
      for (const one of news.drones) this.drones.set(one.name, one);
      for (const id of news.gone_fires) this.fires.delete(id);
      for (const name of news.gone_drones) this.drones.delete(name);
    }
    if (news.kind === "all" || news.fires.length || news.gone_fires.length) this._urgent = null;
    [this.towers, this.fronts, this.ground] = [news.towers, news.fronts, news.ground];
    this._nowS = news.now_s;
    this._at = performance.now();
  }

  /** All that another was told, as of then. @param {Store} other */
  showAs(other) {
    [this.fires, this.drones] = [new Map(other.fires), new Map(other.drones)];
    [this.towers, this.fronts] = [other.towers, other.fronts];
    [this.ground, this._nowS, this._at, this._urgent] = [other.ground, other._nowS, other._at, null];
  }

  /** @returns {number} the ground's time; the computer's own clock may be wrong */
  nowS() {
    return this._nowS + (this.isPast ? 0 : (performance.now() - this._at) / 1000);
  }

  /** @param {Fire} fire @returns {number | null} seconds since it was seen */
  ageS(fire) {
    const ageS = fire.seen_s === null ? null : this.nowS() - fire.seen_s;
    return ageS === null || ageS < -AHEAD_S ? null : ageS;
  }

  /** @param {Drone} drone @returns {number} seconds since it was heard; endless where that cannot be */
  quietS(drone) {
    const quietS = this.nowS() - drone.heard_s;
    return quietS < -AHEAD_S ? Infinity : quietS;
  }

  /** @param {Fire} fire @returns {Fire[]} those of other drones that may be the same fire */
  twinsOf(fire) {
    return fire.may_be.flatMap((id) => this.fires.get(id) ?? []);
  }

  /** @param {Fire} fire @returns {Fire[]} drones' own that a fused one is made of; what may be another's comes last */
  membersOf(fire) {
    const { contributors = [], undecided = [] } = fire.made_of ?? {};
    return [...contributors, ...undecided].flatMap((id) => this.fires.get(id) ?? []);
  }

  /** @returns {Fire[]} each fire once, not what a fused one is made of; the most urgent first: confirmed and not yet acknowledged, then by state, then the newest */
  urgent() {
    this._urgent ??= [...this.fires.values()].filter((one) => !one.fused).sort(
      (a, b) => rank(a) - rank(b) || (b.first_s ?? 0) - (a.first_s ?? 0) || (a.id < b.id ? -1 : 1),
    );
    return this._urgent;
  }
}

/** @param {Fire} fire */
function rank(fire) {
  if (fire.mark?.verdict === "not_a_fire") return 9;
  const state = ORDER.indexOf(fire.state);
  return 2 * state + (fire.mark?.is_acknowledged ? 1 : 0);
}

/** @param {Fire} fire @returns {string} its state as the page names and draws it */
export function kindOf(fire) {
  return fire.mark?.verdict === "not_a_fire" ? "not_a_fire" : fire.state;
}

/** @param {Fire} fire @returns {string} the name that people gave it, or the drone's and its number; a number begins anew with each flight.
 * A fused one is named after the drone that had it first. */
export function nameOf(fire) {
  const others = (fire.made_of?.contributors.length ?? 0) + (fire.made_of?.towers.length ?? 0) - 1;
  const name = fire.mark?.name || `${fire.vehicle} no.\u00a0${fire.target}${others > 0 ? ` +${others}` : ""}`;
  return fire.is_earlier ? `${name} (earlier)` : name;
}

/** @type {Record<string, string>} */
export const WORDS = {
  confirmed: "Confirmed",
  coasting: "Out of view",
  tentative: "Not sure yet",
  dismissed: "Given up",
  not_a_fire: "Not a fire",
};
