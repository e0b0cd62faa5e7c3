// Color tables of costmaps and scores; colors of the theme.
const rgba = (r, g, b, a = 255) => (a << 24 | b << 16 | g << 8 | r) >>> 0; // ImageData is little endian

function table(graded, inscribed, lethal, unknown) {
  const colors = new Uint32Array(256);
  for (let cost = 1; cost < 253; cost++) colors[cost] = rgba(...graded((cost - 1) / 251), 235);
  colors[253] = rgba(...inscribed);
  colors[254] = rgba(...lethal);
  colors[255] = rgba(...unknown, 150);
  return colors;
}

// control points of cividis (Nunez, Anderton, Renslow 2018), which looks alike to people with and without color vision deficiency
const CIVIDIS = [[0, 34, 78], [53, 69, 108], [102, 105, 112], [148, 142, 119], [200, 184, 102], [254, 232, 56]];
function along(points, u) {
  const at = Math.min(u * (points.length - 1), points.length - 1.0001);
  const k = Math.floor(at), f = at - k;
  return points[k].map((v, i) => Math.round(v + f * (points[k + 1][i] - v)));
}

export const COSTMAPS = {
  // as RViz: blue to red, cyan inscribed, magenta lethal
  rviz: table((u) => [Math.round(255 * u), 0, Math.round(255 * (1 - u))], [0, 255, 255], [255, 0, 255], [112, 137, 134]),
  cividis: table((u) => along(CIVIDIS, u), [230, 97, 1], [20, 20, 20], [150, 150, 150]),
};

/** Best 0 .. worst 1 -> CSS color. */
export function score(u, scheme) {
  if (scheme === 'cividis') { const [r, g, b] = along(CIVIDIS, 1 - u); return `rgb(${r} ${g} ${b})`; }
  return `hsl(${Math.round(145 * (1 - u))} 85% 42%)`;
}

export function potentialTable() {
  const colors = new Uint32Array(256);
  for (let v = 0; v < 255; v++) {
    const band = Math.floor(v / 8) % 2;
    const [r, g, b] = along([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], v / 254);
    colors[v] = rgba(r, g, b, band ? 215 : 180);
  }
  return colors;
}

/** Colors of the style sheet, read again when the theme changes. */
export class Theme {
  constructor(changed) {
    this.read();
    for (const query of ['(prefers-color-scheme: dark)']) {
      matchMedia(query).addEventListener('change', () => { this.read(); changed(); });
    }
  }
  read() {
    const style = getComputedStyle(document.documentElement);
    this.version = (this.version ?? 0) + 1;
    for (const name of ['text', 'muted', 'line', 'accent', 'bad', 'surface', 'raised', 'map-free', 'map-wall', 'map-unknown', 'map-outside', 'plan', 'trail',
      'scan', 'robot', 'robot-edge', 'robot2', 'goal', 'shape', 'shape-fill', 'person', 'trajectory', 'grid', 'chart-1', 'chart-2', 'chart-3']) {
      this[name.replace(/-(.)/g, (_, c) => c.toUpperCase())] = style.getPropertyValue(`--${name}`).trim();
    }
  }
  pixel(name) {
    const [r, g, b] = this[name].match(/^#(..)(..)(..)/).slice(1).map((hex) => parseInt(hex, 16));
    return rgba(r, g, b);
  }
}
