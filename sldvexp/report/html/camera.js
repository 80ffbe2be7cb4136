// Where one looks from: azimuth and elevation about a point, and the matrix that follows from them.
"use strict";
const makeCamera = (low, high, { azimuth, elevation }) => {
  const LENS = 4.5;  // 1 / tan of half the angle of view
  let middle, radius, corners;
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const START = { azimuth, elevation };
  const own = { ...START, distance: 1, target: [0, 0, 0], flat: false, shift: [0, 0], width: 1, height: 1 };

  // What is to be seen lies in a box.
  own.around = (least, most) => {
    middle = [0, 1, 2].map((k) => (least[k] + most[k]) / 2);
    radius = Math.hypot(...[0, 1, 2].map((k) => most[k] - least[k])) / 2;
    corners = [...Array(8).keys()].map((n) => [0, 1, 2].map((k) => (n >> k & 1 ? most : least)[k]));
  };
  own.around(low, high);
  const axes = () => {
    const [a, e] = [own.azimuth * Math.PI / 180, own.elevation * Math.PI / 180];
    const toward = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    return { toward, right: [-Math.sin(a), Math.cos(a), 0],
      up: [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)] };
  };
  own.toward = () => axes().toward;
  // Rows of the matrix act on (x, y, z, 1); the depth of a point is its distance along the view.
  own.rows = () => {
    const { toward, right, up } = axes(), { distance, target } = own;
    const away = [...toward.map((t) => -t), distance + dot(toward, target)];
    const w = own.flat ? [0, 0, 0, distance] : away;
    const across = (direction, factor, shift) =>
      [...direction.map((d) => factor * d), -factor * dot(direction, target)].map((x, k) => x + shift * w[k]);
    const reach = 2 * radius + Math.hypot(...target.map((t, k) => t - middle[k]));
    const far = distance + reach, near = own.flat ? distance - reach : Math.max(distance - reach, 0.02 * distance);
    const depth = own.flat
      ? away.map((x, k) => distance * (2 * x - (k === 3 ? far + near : 0)) / (far - near))
      : away.map((x, k) => ((far + near) * x - (k === 3 ? 2 * far * near : 0)) / (far - near));
    return [across(right, LENS * own.height / own.width, own.shift[0]), across(up, LENS, own.shift[1]), depth, w];
  };
  own.matrix = () => {
    const rows = own.rows();
    return new Float32Array([0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])));
  };
  // In pixels from the upper left corner, and as deep as seen.
  own.projector = () => {
    const rows = own.rows();
    return (x, y, z) => {
      const [cx, cy, cz, w] = rows.map((row) => row[0] * x + row[1] * y + row[2] * z + row[3]);
      return [(1 + cx / w) * own.width / 2, (1 - cy / w) * own.height / 2, cz / w];
    };
  };
  // As near as the whole box is seen, with room for what is written around it.
  own.fit = (room) => {
    own.target = [...middle];
    own.shift = [0, 0];
    const spread = (distance) => {
      own.distance = distance;
      const project = own.projector(), seen = corners.map((c) => project(...c));
      return [0, 1].map((k) => [Math.min(...seen.map((s) => s[k])), Math.max(...seen.map((s) => s[k]))]);
    };
    const free = [Math.max(50, own.width - room.left - room.right), Math.max(50, own.height - room.top - room.bottom)];
    let [least, most] = [1.5 * radius, 100 * radius];
    for (let step = 0; step < 40; step++) {
      const distance = Math.sqrt(least * most);
      if (spread(distance).every(([a, b], k) => b - a <= free[k])) most = distance; else least = distance;
    }
    const [across, down] = spread(most).map(([a, b]) => (a + b) / 2);
    own.shift = [2 * (room.left + free[0] / 2 - across) / own.width, -2 * (room.top + free[1] / 2 - down) / own.height];
  };
  own.turn = (right, up) => {
    own.azimuth -= right;
    own.elevation = Math.max(-90, Math.min(90, own.elevation + up));
  };
  own.zoom = (factor) => {
    own.distance = Math.max(1.05 * (own.flat ? 0.01 : 0.3) * radius, Math.min(100 * radius, own.distance / factor));
  };
  own.move = (right, down) => {
    own.shift = [own.shift[0] + 2 * right / own.width, own.shift[1] - 2 * down / own.height];
  };
  own.start = START;
  return own;
};
