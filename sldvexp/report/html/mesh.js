// Lines of a surface of triangles: its rim, its cells, and where a plane cuts it.
"use strict";
const makeMesh = (position, triangles) => {
  const nodes = position.length / 3;
  const at = (n) => [position[3 * n], position[3 * n + 1], position[3 * n + 2]];
  const minus = (a, b) => a.map((x, k) => x - b[k]), dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
  const cross = (a, b) => [0, 1, 2].map((k) => a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3]);
  const sides = new Map();
  for (let t = 0; t < triangles.length; t += 3) {
    const corner = [triangles[t], triangles[t + 1], triangles[t + 2]];
    const pairs = [[0, 1], [1, 2], [2, 0]].map(([a, b]) => [corner[a], corner[b]]);
    const lengths = pairs.map(([a, b]) => Math.hypot(...minus(at(a), at(b))));
    const sorted = [...lengths].sort((a, b) => b - a);
    pairs.forEach(([a, b], k) => {
      const key = Math.min(a, b) * nodes + Math.max(a, b);
      const side = sides.get(key) || { pair: [a, b], faces: 0, diagonal: true };
      side.faces += 1;
      side.diagonal = side.diagonal && lengths[k] === sorted[0] && sorted[0] > 1.01 * sorted[1];
      sides.set(key, side);
    });
  }
  const all = [...sides.values()];
  const those = (keep) => all.filter(keep).flatMap((side) => side.pair);

  // Points of the surface on the way from node to node, in the plane of the way and the normal there:
  // each lies between nodes a and b, a share of the way from a to b, and so far along.
  const cut = (from, to, normal) => {
    const way = minus(at(to), at(from)), length = Math.hypot(...way), along = way.map((x) => x / length);
    const across = cross(along, normal), tiny = 1e-6 * length, found = new Map();
    const beside = (n) => dot(minus(at(n), at(from)), across), far = (n) => dot(minus(at(n), at(from)), along);
    const add = (a, b, share) => {
      const distance = far(a) + share * (far(b) - far(a));
      if (distance < -tiny || distance > length + tiny) return;
      found.set(Math.round(distance / (10 * tiny)), { a, b, share, distance });
    };
    for (const { pair: [a, b] } of all) {
      const [left, right] = [beside(a), beside(b)];
      if (Math.abs(left) <= tiny) add(a, a, 0);
      if (Math.abs(right) <= tiny) add(b, b, 0);
      if (Math.abs(left) > tiny && Math.abs(right) > tiny && left * right < 0) add(a, b, left / (left - right));
    }
    return [...found.values()].sort((p, q) => p.distance - q.distance);
  };
  return { rim: those((s) => s.faces === 1), inner: those((s) => s.faces > 1 && !s.diagonal), cut };
};
