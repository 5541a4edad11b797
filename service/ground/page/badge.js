/** A state's symbol beside text, the same shape as on the map. */

const NS = "http://www.w3.org/2000/svg";
/** @type {Record<string, string>} */
const PATHS = {
  confirmed: "M10 2 18 17H2Z",
  coasting: "M10 2 18 10 10 18 2 10Z",
  tentative: "M3 10a7 7 0 1 1 14 0a7 7 0 1 1-14 0Z",
  dismissed: "M4 4 16 16M4 16 16 4",
  not_a_fire: "M3 10a7 7 0 1 1 14 0a7 7 0 1 1-14 0ZM5 15 15 5",
  ring: "M1 10a9 5 0 1 1 18 0a9 5 0 1 1-18 0Z",
  dots: "M1 10a9 6 0 1 1 18 0a9 6 0 1 1-18 0Z",
  drone: "M10 1 16 17 10 13 4 17Z",
};

/** @param {string} kind @returns {SVGElement} */
export function badge(kind) {
  const svg = document.createElementNS(NS, "svg");
  svg.setAttribute("viewBox", "0 0 20 20");
  svg.setAttribute("class", `badge ${kind}`);
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(NS, "path");
  path.setAttribute("d", PATHS[kind] ?? PATHS.dismissed);
  svg.append(path);
  return svg;
}
