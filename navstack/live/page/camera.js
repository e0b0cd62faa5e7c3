// Map coordinates (m, y up) <-> pixels of the canvas.
export class Camera {
  constructor() { this.x = 0; this.y = 0; this.scale = 40; this.width = 1; this.height = 1; this.set = this.fitted = false; }

  /** The map keeps its place at the left: a panel that opens at the right does not move it under the pointer. */
  resize(width, height) {
    if (this.set && this.width > 1) this.x += (width - this.width) / 2 / this.scale;
    this.width = width;
    this.height = height;
  }

  /** Shows an area; `below` are pixels at the bottom that something else covers. */
  fit([left, right, bottom, top], below = 0) {
    this.scale = Math.max(4, 0.94 * Math.min(this.width / (right - left), (this.height - below) / (top - bottom)));
    this.x = (left + right) / 2;
    this.y = (bottom + top) / 2 - below / 2 / this.scale;
    this.set = this.fitted = true;
  }

  toScreen(x, y) { return [this.width / 2 + (x - this.x) * this.scale, this.height / 2 - (y - this.y) * this.scale]; }

  toMap(u, v) { return [this.x + (u - this.width / 2) / this.scale, this.y - (v - this.height / 2) / this.scale]; }

  zoom(factor, u = this.width / 2, v = this.height / 2) {
    const [x, y] = this.toMap(u, v);
    this.fitted = false;
    this.scale = Math.min(1500, Math.max(2, this.scale * factor));
    const [x2, y2] = this.toMap(u, v);
    this.x += x - x2;
    this.y += y - y2;
  }

  pan(du, dv) { this.fitted = false; this.x -= du / this.scale; this.y += dv / this.scale; }

  /** Length for the scale bar: meters (1, 2 or 5 times a power of ten) and pixels. */
  bar() {
    const wanted = 90 / this.scale, power = 10 ** Math.floor(Math.log10(wanted));
    const meters = [5, 2, 1].map((k) => k * power).find((m) => m <= wanted) ?? power;
    return { meters, pixels: meters * this.scale };
  }
}
