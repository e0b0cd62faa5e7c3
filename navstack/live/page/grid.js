// A grid of bytes with an image that is colored by a table.
export class Grid {
  constructor() { this.clear(); }

  clear() { this.cells = null; this.image = null; this.dirty = null; this.colored = null; }

  update(change, blobs) {
    const { nx, ny } = change;
    if (!this.cells || this.nx !== nx || this.ny !== ny) {
      Object.assign(this, { nx, ny, cells: new Uint8Array(nx * ny) });
      this.image = null;
    }
    this.resolution = change.resolution;
    this.origin = change.origin;
    if (change.shift) { this.shift(...change.shift); this.mark([0, 0, nx, ny]); }
    if (change.blob !== undefined) {
      const [x0, y0, x1, y1] = change.box, source = new Uint8Array(blobs[change.blob]), width = x1 - x0;
      for (let y = y0; y < y1; y++) this.cells.set(source.subarray((y - y0) * width, (y - y0 + 1) * width), y * nx + x0);
      this.mark(change.box);
    }
  }

  shift(dx, dy) {
    const { nx, ny, cells } = this, moved = new Uint8Array(nx * ny);
    for (let y = Math.max(0, -dy); y < Math.min(ny, ny - dy); y++) {
      const from = Math.max(0, dx), to = Math.min(nx, nx + dx);
      if (from >= to) break; // moved by more than its width
      moved.set(cells.subarray((y + dy) * nx + from, (y + dy) * nx + to), y * nx + Math.max(0, -dx));
    }
    this.cells = moved;
  }

  mark([x0, y0, x1, y1]) {
    const d = this.dirty;
    this.dirty = d ? [Math.min(d[0], x0), Math.min(d[1], y0), Math.max(d[2], x1), Math.max(d[3], y1)] : [x0, y0, x1, y1];
  }

  at(x, y) {
    if (!this.cells) return null;
    const ix = Math.floor((x - this.origin[0]) / this.resolution), iy = Math.floor((y - this.origin[1]) / this.resolution);
    return ix < 0 || iy < 0 || ix >= this.nx || iy >= this.ny ? null : this.cells[iy * this.nx + ix];
  }

  /** The image of the cells, row 0 at the top of the canvas (the smallest y): draw it with a flipped y axis. */
  canvas(table) {
    if (!this.cells) return null;
    if (!this.image) {
      this.image = document.createElement('canvas');
      this.image.width = this.nx;
      this.image.height = this.ny;
      this.dirty = [0, 0, this.nx, this.ny];
    }
    if (this.colored !== table) { this.colored = table; this.dirty = [0, 0, this.nx, this.ny]; }
    if (this.dirty) {
      const [x0, y0, x1, y1] = this.dirty, width = x1 - x0, data = new ImageData(width, y1 - y0), out = new Uint32Array(data.data.buffer);
      for (let y = y0; y < y1; y++) {
        const row = y * this.nx;
        for (let x = x0; x < x1; x++) out[(y - y0) * width + x - x0] = table[this.cells[row + x]];
      }
      this.image.getContext('2d').putImageData(data, x0, y0);
      this.dirty = null;
    }
    return this.image;
  }
}
