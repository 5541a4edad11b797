/** Elements made and changed; text is always text, whoever wrote it. */

/**
 * @param {string} tag
 * @param {Record<string, string | EventListener>} attributes `on...` are listeners, the rest attributes
 * @param {...(Node | string)} children
 * @returns {HTMLElement}
 */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

/** @param {string} id @returns {HTMLElement} the page's own element of that id */
export function byId(id) {
  const found = document.getElementById(id);
  if (found === null) throw new Error(`no element ${id}`);
  return found;
}

/** Set a text only where it is another: what reads the page aloud is told of changes alone. */
export function setText(/** @type {Element} */ where, /** @type {string} */ text) {
  if (where.textContent !== text) where.textContent = text;
}

/** @param {string} name @returns {string | null} what the browser keeps for this page */
export function kept(name) {
  try {
    return localStorage.getItem(name);
  } catch {
    return null; // it may forbid that
  }
}

export function keep(/** @type {string} */ name, /** @type {string} */ value) {
  try {
    localStorage.setItem(name, value);
  } catch {
    // then it is forgotten with the page
  }
}
