// A picture of cells at DAC steps: as many as come, painted as they come, anew when the window moves.

const ANCHORS = [[13, 8, 60], [75, 20, 120], [150, 40, 110], [215, 85, 70], [250, 160, 60], [252, 250, 190]];
const SHADES = 256;
/** Shades of a velocity from none to the largest, as pixels of a canvas. */
export const RAMP = new Uint32Array(SHADES);
for (let i = 0; i < SHADES; i++) {
  const place = (i / (SHADES - 1)) * (ANCHORS.length - 1), low = Math.min(Math.floor(place), ANCHORS.length - 2);
  const [r, g, b] = ANCHORS[low].map((c, k) => Math.round(c + (place - low) * (ANCHORS[low + 1][k] - c)));
  RAMP[i] = (255 << 24) | (b << 16) | (g << 8) | r;
}
/** Pixels that are not to be trusted are grey, those that are over the range green-blue. */
const FLAGGED = 0xff8c8c8c, SATURATED = 0xffa0c800;
const SATURATED_BIT = 1;

function grown(array, size) {
  if (array.length >= size) return array;
  const more = new array.constructor(Math.max(size, 2 * array.length));
  more.set(array);
  return more;
}

export class Cells {
  constructor(canvas, drawn = () => {}) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.after = drawn;
    this.low = [-4096, -4096];
    this.high = [4096, 4096];
    this.ways = [1, 1];
    this.forget();
  }

  forget() {
    this.count = 0;
    this.painted = 0;
    this.top = 0;
    this.up = new Int32Array(1024);
    this.left = new Int32Array(1024);
    this.value = new Float32Array(1024);
    this.flag = new Uint8Array(1024);
    this.tall = new Int32Array(1024);
    this.wide = new Int32Array(1024);
    this.ask();
  }

  /** Add cells: pairs of DAC steps, values, flags, and their height and width in steps. */
  add(dac, value, flag, tall, wide = tall) {
    const size = this.count + value.length;
    for (const name of ["up", "left", "value", "flag", "tall", "wide"]) this[name] = grown(this[name], size);
    let top = this.top;
    for (let i = 0; i < value.length; i++) {
      const at = this.count + i;
      this.up[at] = dac[2 * i];
      this.left[at] = dac[2 * i + 1];
      this.value[at] = value[i];
      this.flag[at] = flag[i];
      this.tall[at] = tall;
      this.wide[at] = wide;
      if (!flag[i] && value[i] > top) top = value[i];
    }
    this.count = size;
    if (top > this.top) {
      this.top = top;
      this.painted = 0;
    }
    this.ask();
  }

  /** Which way steps grow, as the eye sees it: 1 is up, and to the left. */
  turn(ways) {
    this.ways = ways;
    this.painted = 0;
    this.ask();
  }

  show(low, high) {
    this.low = low;
    this.high = high;
    this.painted = 0;
    this.ask();
  }

  ask() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.draw(); });
  }

  /** Paint what is not painted yet; all of it if the window or the range has changed. */
  draw() {
    const { width, height } = this.canvas;
    if (!this.image || this.image.width !== width || this.image.height !== height) {
      this.image = this.context.createImageData(width, height);
      this.pixels = new Uint32Array(this.image.data.buffer);
      this.painted = 0;
    }
    if (this.painted === 0) this.pixels.fill(0);
    const perUp = height / (this.high[0] - this.low[0]), perLeft = width / (this.high[1] - this.low[1]);
    const shade = this.top > 0 ? (SHADES - 1) / this.top : 0;
    const { up, left, value, flag, tall, wide, pixels } = this;
    const [upwards, leftwards] = this.ways.map((way) => way > 0);
    const top = this.high[0], bottom = this.low[0], most = this.high[1], least = this.low[1];
    for (let i = this.painted; i < this.count; i++) {
      const y = (upwards ? top - up[i] : up[i] - bottom) * perUp, x = (leftwards ? most - left[i] : left[i] - least) * perLeft;
      const h = tall[i] * perUp * 0.5, w = wide[i] * perLeft * 0.5;
      if (y + h < 0 || y - h > height || x + w < 0 || x - w > width) continue;
      const y0 = Math.max(0, Math.floor(y - h)), x0 = Math.max(0, Math.floor(x - w));
      const y1 = Math.min(height, Math.max(Math.ceil(y + h), y0 + 1)), x1 = Math.min(width, Math.max(Math.ceil(x + w), x0 + 1));
      const colour = flag[i] === 0 ? RAMP[Math.min(SHADES - 1, (value[i] * shade) | 0)] : flag[i] & SATURATED_BIT ? SATURATED : FLAGGED;
      // A call of fill costs more than a few pixels do.
      for (let row = y0 * width; row < y1 * width; row += width) {
        if (x1 - x0 > 16) pixels.fill(colour, row + x0, row + x1);
        else for (let at = row + x0; at < row + x1; at++) pixels[at] = colour;
      }
    }
    this.painted = this.count;
    this.context.putImageData(this.image, 0, 0);
    this.after();
  }

  /** Where DAC steps are seen, from 0 to 1 across and down. */
  placeOf([up, left]) {
    const across = (this.high[1] - left) / (this.high[1] - this.low[1]), down = (this.high[0] - up) / (this.high[0] - this.low[0]);
    return [this.ways[1] > 0 ? across : 1 - across, this.ways[0] > 0 ? down : 1 - down];
  }

  /** DAC steps of a place. */
  stepsAt(across, down) {
    const back = [this.ways[0] > 0 ? down : 1 - down, this.ways[1] > 0 ? across : 1 - across];
    return back.map((share, k) => Math.round(this.high[k] - share * (this.high[k] - this.low[k])));
  }
}

/** Write a frequency, Hz, with as many digits as tell two lines apart. */
function hertz(frequency) {
  return `${Number(frequency.toPrecision(6))} Hz`;
}

/** Say at which frequency a picture is, and of how many it is the one at which most moves. */
export function atFrequency({ frequency, among }) {
  return `at ${hertz(frequency)}${among > 1 ? `, where most moves, of ${among} frequencies` : ""}`;
}

/** Paint a ramp into a small canvas. */
export function paintRamp(canvas) {
  const context = canvas.getContext("2d"), image = context.createImageData(canvas.width, canvas.height);
  const pixels = new Uint32Array(image.data.buffer);
  for (let i = 0; i < pixels.length; i++) pixels[i] = RAMP[Math.floor(((i % canvas.width) / canvas.width) * SHADES)];
  context.putImageData(image, 0, 0);
}
