/** The page: hears the ground over a WebSocket and shows what it told. */

import { Alerts } from "./alerts.js";
import { badge } from "./badge.js";
import { Detail, marked } from "./detail.js";
import { byId, element, keep, kept, setText } from "./dom.js";
import { DroneList, inWords, loadMeanings } from "./drones.js";
import { FireTable } from "./fires.js";
import { clock, minutes, placeOf } from "./geo.js";
import { FireMap } from "./map.js";
import { Store, WORDS } from "./store.js";
import { showTowers } from "./together.js";
import { TimeLine } from "./past.js";

const SILENT_MS = 4000;
const TABLE_MS = 200;
const AGAIN_MS = 1000;

const store = new Store();
const map = new FireMap(byId("map"), store, pick);
const table = new FireTable(store, pick);
const detail = new Detail(store, pick, mark, inWords);
const drones = new DroneList(store);
const alerts = new Alerts(pickNow, (fire) => mark(fire, { is_acknowledged: true }));
const line = new TimeLine(store, show);

/** @type {WebSocket | null} */ let socket = null;
let heardAt = 0;
let hasFitted = false;
let isTableDue = false;

/** Somebody's word on a fire, on each that a fused one is made of: so it holds wherever these go.
 * @param {import("./store.js").Fire} fire @param {object} change */
function mark(fire, change) {
  for (const one of fire.made_of ? line.live.membersOf(fire) : [fire])
    if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(marked({ ...one, mark: fire.mark }, change)));
}

/** @param {string | null} id */
function pick(id) {
  store.selected = id;
  history.replaceState(null, "", id ? `#${encodeURIComponent(id)}` : location.pathname);
  const fire = store.fires.get(id ?? "");
  if (fire && fire.lat_deg !== null && fire.lon_deg !== null && !map.leaflet.getBounds().contains([fire.lat_deg, fire.lon_deg]))
    map.centre({ lat: fire.lat_deg, lon: fire.lon_deg });
  show();
  if (fire && matchMedia("(max-width: 800px)").matches) byId("detail").scrollIntoView({ block: "start" });
}

/** From an alert: it is of now. @param {string} id */
function pickNow(id) {
  line.back();
  pick(id);
}

function show() {
  map.redraw();
  alerts.show(line.live);
  if (isTableDue) return;
  isTableDue = true;
  setTimeout(showText, document.hidden ? 1000 : TABLE_MS / 4);
}

function showText() {
  isTableDue = false;
  table.show(map.own);
  detail.show(map.own);
  drones.show();
  showTowers(store);
  showLink();
}

function showLink() {
  const [pill, ground] = [byId("link"), line.live.ground];
  const lost = Object.entries(ground?.links ?? {}).filter(([, is]) => !is).map(([endpoint]) => endpoint);
  let [state, text] = ["well", `Live ${clock(store.nowS())}`];
  if (ground === null) [state, text] = ["bad", "Connecting"];
  else if (performance.now() - heardAt > SILENT_MS) [state, text] = ["bad", "No word from the ground: what is shown is old"];
  else if (store.isPast) [state, text] = ["past", `As it was at ${clock(store.nowS())}`];
  else if (ground.replay) [state, text] = ["past", `Replay of ${ground.replay}, ${clock(store.nowS())}`];
  else if (lost.length) [state, text] = ["bad", `Not connected to ${lost.join(", ")}: trying again`];
  pill.dataset.state = state;
  setText(pill, text);
  document.title = `${line.live.urgent().filter((one) => one.state === "confirmed").length} fires: distloc`;
  let recorded = "";
  if (ground?.record_fault) recorded = `Not recorded: ${ground.record_fault}`;
  else if (ground?.recorded_s) recorded = `Recorded until ${clock(ground.recorded_s)}`;
  if (ground?.record_lost) recorded += `, without ${ground.record_lost} messages that the disk did not take`;
  if (ground?.left_out) recorded += ` ${ground.left_out} drones or fires had no place.`;
  setText(byId("recorded"), recorded);
  byId("recorded").classList.toggle("fault", Boolean(ground?.record_fault || ground?.record_lost));
}

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
  socket.onmessage = (event) => {
    heardAt = performance.now();
    line.take(JSON.parse(event.data));
    socket?.send(""); // ready for more: what is shown is never older than one message
    if (!hasFitted && (store.fires.size || [...store.drones.values()].some((one) => one.lat_deg !== null))) {
      hasFitted = true;
      map.fit();
      const asked = decodeURIComponent(location.hash.slice(1));
      if (store.fires.has(asked)) pick(asked);
    }
    show();
  };
  socket.onclose = () => setTimeout(connect, AGAIN_MS);
}

/** @param {string} theme */
function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  setText(byId("theme"), theme === "dark" ? "Light" : "Dark");
  map.readColours();
}

/** @param {HTMLElement} button @returns {boolean} whether it is pressed now */
function press(button) {
  const isOn = button.getAttribute("aria-pressed") !== "true";
  button.setAttribute("aria-pressed", String(isOn));
  return isOn;
}

/** @param {string} text */
function setOwn(text) {
  const place = placeOf(text);
  setText(byId("own-fault"), place || !text.trim() ? "" : `${text} is no place: write 47 25.664 N 8 36.335 E or 47.42774, 8.60559`);
  map.own = place;
  if (place || !text.trim()) keep("own", text);
  show();
}

byId("fit").addEventListener("click", () => map.fit());
byId("each").addEventListener("click", () => {
  map.showsEach = press(byId("each"));
  map.redraw();
});
byId("measure").addEventListener("click", () => map.measure(press(byId("measure"))));
byId("sound").addEventListener("click", () => (alerts.isLoud = press(byId("sound"))));
byId("theme").addEventListener("click", () => {
  const theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  keep("theme", theme);
  setTheme(theme);
});
const ownPlace = /** @type {HTMLInputElement} */ (byId("own-place"));
byId("own").addEventListener("submit", (event) => {
  event.preventDefault();
  setOwn(ownPlace.value);
});
map.onPointer((place) => setText(byId("cursor"), minutes(place)));
/** @type {Record<string, string>} */
const KEYS = { f: "fit", m: "measure", d: "theme" };
document.addEventListener("keydown", (event) => {
  if (event.target instanceof HTMLInputElement || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === "Escape") pick(null);
  else if (event.key in KEYS) byId(KEYS[event.key]).click();
});
for (const kind of ["confirmed", "coasting", "tentative", "dismissed"])
  byId("legend").append(element("li", {}, badge(kind), WORDS[kind]));
byId("legend").append(element("li", {}, badge("ring"), "Fire within, 95 %"), element("li", {}, badge("dots"), "Smoke within"));
/** For tests and the curious: look at a place, and what the map then shows. */
window.distloc = { look: (lat, lon, pixelsAKm) => map.look(lat, lon, pixelsAKm) };
setTheme(kept("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
ownPlace.value = kept("own") ?? "";
setOwn(ownPlace.value);
setInterval(show, 1000);
Promise.allSettled([loadMeanings(), map.loadBackground()]).finally(connect);
