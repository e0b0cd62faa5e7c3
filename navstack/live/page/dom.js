// Small helpers for elements.
export const $ = (id) => document.getElementById(id);

export function el(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (key.startsWith('on')) element.addEventListener(key.slice(2), value);
    else if (key in element && key !== 'list') element[key] = value;
    else element.setAttribute(key, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

export function icon(name) {
  const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg'), use = document.createElementNS('http://www.w3.org/2000/svg', 'use');
  use.setAttribute('href', `icons.svg#${name}`);
  svg.append(use);
  svg.setAttribute('aria-hidden', 'true');
  return svg;
}

export function button(name, label, onclick, properties = {}) {
  return el('button', { type: 'button', title: label, 'aria-label': label.replace(/ \(.*\)$/, ''), onclick, ...properties }, icon(name));
}

export function setIcon(element, name) { element.querySelector('use').setAttribute('href', `icons.svg#${name}`); }

/** Replaces the children only if `key` differs from the last call: keeps focus and open menus. */
export function refresh(element, key, make) {
  if (element.refreshKey === key) return;
  element.refreshKey = key;
  element.replaceChildren(...make());
}

export function toast(text, severity = 'info') {
  const box = $('toasts'), item = el('div', { className: `toast ${severity}` }, text);
  box.append(item);
  while (box.children.length > 4) box.firstChild.remove();
  setTimeout(() => item.remove(), severity === 'info' ? 4000 : 9000);
}

export const fixed = (value, digits) => (value === null || value === undefined ? '–' : value.toFixed(digits));
/** The number of the first goal that waits. */
export const nextNumber = ({ under_way, ended }) => 1 + Math.max(0, ...[...under_way, ...ended].map((goal) => goal.number));

export const poseText = (pose) => pose.slice(0, 3).map((v) => v.toFixed(2)).join(',');

export async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    toast(`copied ${text}`);
  } catch {
    toast(text); // no permission: at least it can be selected
  }
}
