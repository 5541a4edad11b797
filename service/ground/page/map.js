/** The map: Leaflet moves and zooms it, a canvas over it shows what the ground told. */

import { drawDrone, drawFire, drawTwins, label } from "./draw.js";
import { byId, setText } from "./dom.js";
import { bearing, fromTo, mercator, metres, metresADegree, minutes } from "./geo.js";
import { drawGrid } from "./grid.js";
import { kindOf } from "./store.js";
import { drawFront, drawMember, drawOutvoted, drawTower } from "./together.js";

/** @typedef {import("./geo.js").Place} Place */

const PICK_PX = 24;
const MAX_ZOOM = 19;
const MOST_ENLARGED = 5; // zooms beyond what tiles have
const NAMED_AT_MOST = 40;
const LOST_S = 10;
const NAMED_PLACES = 300;
const LARGEST_FIT_M = 20000;
const COLOURS = ["ink", "faint", "halo", "grid", "drone", "smoke", "own", "confirmed", "coasting", "tentative"];

export class FireMap {
  /** @param {HTMLElement} where @param {import("./store.js").Store} store @param {(id: string | null) => void} onPick */
  constructor(where, store, onPick) {
    this._store = store;
    this._onPick = onPick;
    this._isDue = false;
    /** @type {Place | null} */ this.own = null;
    this.showsEach = false; // drones' own ellipses under the fused ones
    /** @type {Record<string, string>} */ this._colours = {};
    /** @type {Place[] | null} */ this._measured = null;
    /** @type {any} */ this._map = window.L.map(where, {
      attributionControl: false,
      zoomAnimation: false,
      fadeAnimation: false,
      zoomSnap: 0.5,
      minZoom: 2,
      maxZoom: MAX_ZOOM,
      worldCopyJump: true,
      zoomControl: false,
    });
    window.L.control.zoom({ position: "topleft" }).addTo(this._map);
    window.L.control.scale({ imperial: false, position: "bottomleft" }).addTo(this._map);
    this._places = window.L.canvas();
    this._canvas = document.createElement("canvas");
    this._canvas.className = "sheet";
    where.append(this._canvas);
    this._map.setView([46, 8], 4);
    this._map.on("move zoom resize viewreset", () => this.redraw());
    this._map.on("click", (/** @type {any} */ event) => this._click(event));
    this._where = where;
    for (const name of ["focus", "blur"]) where.addEventListener(name, () => this.redraw());
    where.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && event.target === where)
        this._click({ latlng: this._map.getCenter(), containerPoint: this._map.getSize().divideBy(2) });
    });
    new ResizeObserver(() => {
      this._map.invalidateSize({ pan: false }); // alerts come and go above it
      this.fitAtFirst();
      this.redraw();
    }).observe(where);
    this._hasMoved = false;
    this._map.on("dragstart zoomstart", () => (this._hasMoved = this._hasMoved || !this._isFitting));
    this._isFitting = false;
    this.readColours();
  }

  /** The operator's tiles and places, from the ground's own files, if there are any. */
  async loadBackground() {
    const told = await (await fetch("background")).json();
    if (told.tiles) {
      const { url, min_zoom: minZoom, max_zoom: maxNativeZoom, attribution, is_shade: isShade } = told.tiles;
      const maxZoom = isShade ? MAX_ZOOM : Math.min(MAX_ZOOM, maxNativeZoom + MOST_ENLARGED);
      const referrerPolicy = "strict-origin"; // some tile servers ask for it
      window.L.tileLayer(url, { minZoom, maxNativeZoom, maxZoom, referrerPolicy, className: isShade ? "shade" : "pictures" }).addTo(this._map);
      byId("attribution").textContent = attribution;
    }
    if (told.has_places) this._showPlaces(await (await fetch("places")).json());
  }

  /** @param {any} places GeoJSON; names are text, whatever they hold */
  _showPlaces(places) {
    const colour = () => this._colours.faint;
    let named = 0;
    window.L.geoJSON(places, {
      interactive: false,
      style: () => ({ color: colour(), weight: 1.5, fillOpacity: 0.04 }),
      pointToLayer: (/** @type {any} */ _, /** @type {any} */ at) =>
        window.L.circleMarker(at, { radius: 3, color: colour(), renderer: this._places }),
      renderer: this._places,
      onEachFeature: (/** @type {any} */ feature, /** @type {any} */ layer) => {
        const name = feature.properties?.name;
        if (typeof name !== "string" || named++ >= NAMED_PLACES) return;
        const text = document.createElement("span");
        text.textContent = name.slice(0, 60);
        layer.bindTooltip(text, { permanent: true, direction: "right", className: "place-name" });
      },
    }).addTo(this._map);
  }

  /** @returns {any} Leaflet's own */
  get leaflet() {
    return this._map;
  }

  /** The theme's, from the style sheet. */
  readColours() {
    const style = getComputedStyle(document.documentElement);
    this._colours = Object.fromEntries(COLOURS.map((one) => [one, style.getPropertyValue(`--${one}`).trim()]));
    this._colours.dismissed = this._colours.not_a_fire = this._colours.faint;
    this.redraw();
  }

  /** At the screen's next picture, however often it is asked for. */
  redraw() {
    if (this._isDue) return;
    this._isDue = true;
    requestAnimationFrame(() => {
      this._isDue = false;
      this._draw();
    });
  }

  /** @param {(place: Place) => void} listener told where the pointer is */
  onPointer(listener) {
    this._map.on("mousemove", (/** @type {any} */ event) => listener({ lat: event.latlng.lat, lon: event.latlng.lng }));
  }

  /** Show all fires that are shown in full, all drones, and one's own place. */
  fit() {
    const places = [...this._store.fires.values()]
      .filter((one) => !["dismissed", "not_a_fire"].includes(kindOf(one)))
      .concat(/** @type {any} */ ([...this._store.drones.values(), ...this._store.towers]))
      .flatMap((one) => around(one.lat_deg, one.lon_deg, one.ellipse95?.semi_major_m ?? 0));
    if (this.own) places.push([this.own.lat, this.own.lon]);
    if (places.length) this._move(() => this._map.fitBounds(places, { padding: [60, 60], maxZoom: 15, animate: false }));
  }

  /** Fit once there is something, until somebody moves the map. */
  fitAtFirst() {
    if (!this._hasMoved) this.fit();
  }

  /** @param {Place} place */
  centre(place) {
    this._move(() => this._map.setView([place.lat, place.lon], Math.max(this._map.getZoom(), 12), { animate: false }));
    this._hasMoved = true;
  }

  /**
   * @param {number} lat @param {number} lon @param {number} pixelsAKm at least so many
   * @returns {{lat: number, lon: number, zoom: number, width: number, height: number}} what is shown now
   */
  look(lat, lon, pixelsAKm) {
    const zoom = Math.ceil(2 * Math.log2((pixelsAKm * 40075 * Math.cos((lat * Math.PI) / 180)) / 256)) / 2;
    this._move(() => this._map.setView([lat, lon], zoom, { animate: false }));
    this._hasMoved = true;
    const [size, at] = [this._map.getSize(), this._map.containerPointToLatLng(this._map.getSize().divideBy(2))];
    return { lat: at.lat, lon: at.lng, zoom: this._map.getZoom(), width: size.x, height: size.y };
  }

  /** @param {boolean} isOn measure from the next click on */
  measure(isOn) {
    this._measured = isOn ? [] : null;
    this._tellMeasured();
  }

  /** In words as well: a canvas is read to nobody. */
  _tellMeasured() {
    const [a, b] = this._measured ?? [];
    let text = this._measured ? "Measure: take a place" : "";
    if (a && !b) text = `From ${minutes(a)}`;
    if (a && b) text = measured(a, b);
    setText(byId("measured"), text);
    this.redraw();
  }

  /** @param {() => void} change */
  _move(change) {
    this._isFitting = true;
    change();
    this._isFitting = false;
  }

  /** @param {any} event */
  _click(event) {
    if (this._measured) {
      if (this._measured.length === 2) this._measured = [];
      this._measured.push({ lat: event.latlng.lat, lon: event.latlng.lng });
      this._tellMeasured();
      return;
    }
    let [best, nearest] = [/** @type {string | null} */ (null), PICK_PX];
    for (const fire of this._store.urgent()) {
      if (fire.lat_deg === null || fire.lon_deg === null) continue;
      const at = this._map.latLngToContainerPoint([fire.lat_deg, fire.lon_deg]);
      const away = at.distanceTo(event.containerPoint);
      if (away < nearest) [best, nearest] = [fire.id, away];
    }
    this._onPick(best);
  }

  _draw() {
    const size = this._map.getSize();
    const density = window.devicePixelRatio || 1;
    if (this._canvas.width !== Math.round(size.x * density) || this._canvas.height !== Math.round(size.y * density)) {
      this._canvas.width = Math.round(size.x * density);
      this._canvas.height = Math.round(size.y * density);
    }
    const ctx = /** @type {CanvasRenderingContext2D} */ (this._canvas.getContext("2d"));
    ctx.setTransform(density, 0, 0, density, 0, 0);
    ctx.clearRect(0, 0, size.x, size.y);
    const map = this._map;
    const project = mercator(map.getPixelOrigin().subtract(map._getMapPanePos()), 256 * 2 ** map.getZoom());
    const sheet = { ctx, project, width: size.x, height: size.y, density, colours: this._colours, taken: [] };
    const bounds = map.getBounds();
    const edges = { south: bounds.getSouth(), north: bounds.getNorth(), west: bounds.getWest(), east: bounds.getEast() };
    drawGrid(sheet, edges);
    for (const drone of this._store.drones.values())
      drawDrone(sheet, drone, drone.is_alive === false || this._store.quietS(drone) > LOST_S);
    for (const tower of this._store.towers) drawTower(sheet, tower, this._store.nowS());
    for (const front of this._store.fronts) drawFront(sheet, front);
    const fires = this._store.urgent().filter((one) => isNear(one, edges)).reverse(); // the most urgent lies on top
    const isNamed = fires.length <= NAMED_AT_MOST;
    const near = new Set(fires);
    for (const one of fires)
      for (const other of this._store.twinsOf(one))
        if (one.id < other.id || !near.has(other)) drawTwins(sheet, one, other);
    for (const one of fires) {
      const by = this._store.fires.get(one.outvoted_by);
      if (by) drawOutvoted(sheet, one, by);
      if (this.showsEach || one.id === this._store.selected)
        for (const member of this._store.membersOf(one)) drawMember(sheet, member);
    }
    for (const one of fires)
      if (one.id !== this._store.selected) drawFire(sheet, one, this._store.ageS(one), false, isNamed && isLive(one));
    const chosen = this._store.fires.get(this._store.selected ?? "");
    if (chosen) drawFire(sheet, chosen, this._store.ageS(chosen), true, true);
    this._drawOwn(sheet);
  }

  /** @param {import("./draw.js").Sheet} sheet */
  _drawOwn(sheet) {
    const { ctx, project, colours } = sheet;
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = colours.own;
    ctx.lineWidth = 3;
    if (this.own) {
      const at = project(this.own.lat, this.own.lon);
      ctx.strokeRect(at.x - 8, at.y - 8, 16, 16);
      ctx.fillRect(at.x - 2, at.y - 2, 4, 4);
      label(sheet, "own place", at.x + 14, at.y + 5);
    }
    if (this._measured && document.activeElement === this._where) cross(ctx, sheet.width / 2, sheet.height / 2);
    const points = (this._measured ?? []).map((one) => project(one.lat, one.lon));
    for (const at of points) ctx.fillRect(at.x - 4, at.y - 4, 8, 8);
    if (this._measured?.length === 2) {
      const [a, b] = points;
      ctx.beginPath();
      ctx.moveTo(a.x, a.y);
      ctx.lineTo(b.x, b.y);
      ctx.stroke();
      label(sheet, measured(this._measured[0], this._measured[1]), (a.x + b.x) / 2 + 8, (a.y + b.y) / 2 - 8);
    } else if (this._measured?.length === 1) label(sheet, minutes(this._measured[0]), points[0].x + 10, points[0].y - 8);
    ctx.restore();
  }
}

/** @param {Place} a @param {Place} b @returns {string} */
function measured(a, b) {
  const told = fromTo(a, b);
  return `${metres(told.distance)} at ${bearing(told.bearing)}`;
}

/** What Enter takes while one measures by keyboard. @param {CanvasRenderingContext2D} ctx @param {number} x @param {number} y */
function cross(ctx, x, y) {
  ctx.beginPath();
  for (const [right, down] of [[14, 0], [0, 14]]) {
    ctx.moveTo(x - right, y - down);
    ctx.lineTo(x + right, y + down);
  }
  ctx.stroke();
}

/** The place, and with it the corners of what is about it; a size that tells nothing is left out.
 * @param {number | null} lat @param {number | null} lon @param {number} radiusM @returns {number[][]} */
function around(lat, lon, radiusM) {
  if (lat === null || lon === null) return [];
  if (radiusM > LARGEST_FIT_M) return [[lat, lon]];
  const scale = metresADegree(lat);
  const [up, across] = [radiusM / scale.north, radiusM / Math.max(scale.east, 1)];
  return [[lat - up, lon - across], [lat + up, lon + across]];
}

/** Whether it, or its ellipse, may be on the map. @param {import("./store.js").Fire} fire
 * @param {{south: number, north: number, west: number, east: number}} edges */
function isNear(fire, edges) {
  const { lat_deg: lat, lon_deg: lon } = fire;
  if (lat === null || lon === null) return false;
  const [high, wide] = [0.5 * (edges.north - edges.south), 0.5 * (edges.east - edges.west)];
  return lat > edges.south - high && lat < edges.north + high && lon > edges.west - wide && lon < edges.east + wide;
}

/** @param {import("./store.js").Fire} fire */
function isLive(fire) {
  return !["dismissed", "not_a_fire"].includes(kindOf(fire));
}
