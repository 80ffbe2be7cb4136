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
  // each lies between nodes a and b, a share of the way from a to b, and so far along. Of several
  // sheets, as the two walls of a tube, only those count that the plane joins to one of the nodes.
  const cut = (from, to, normal) => {
    const way = minus(at(to), at(from)), length = Math.hypot(...way), along = way.map((x) => x / length);
    const across = cross(along, normal), tiny = 1e-6 * length, found = new Map();
    const beside = (n) => dot(minus(at(n), at(from)), across), far = (n) => dot(minus(at(n), at(from)), along);
    const meet = ([a, b]) => {
      const [left, right] = [beside(a), beside(b)], close = (x) => Math.abs(x) <= tiny;
      const ends = [...close(left) ? [a] : [], ...close(right) ? [b] : []].map((n) => ({ key: n, a: n, b: n, share: 0 }));
      return ends.length || left * right > 0 ? ends
        : [{ key: (1 + Math.min(a, b)) * nodes + Math.max(a, b), a, b, share: left / (left - right) }];
    };
    for (let t = 0; t < triangles.length; t += 3) {
      const here = [[0, 1], [1, 2], [2, 0]].flatMap(([a, b]) => meet([triangles[t + a], triangles[t + b]]))
        .map((p) => ({ ...p, distance: far(p.a) + p.share * (far(p.b) - far(p.a)) }))
        .filter(({ distance }) => distance > -tiny && distance < length + tiny);
      for (const point of here) {
        if (!found.has(point.key)) found.set(point.key, { ...point, joined: [] });
        found.get(point.key).joined.push(...here.map(({ key }) => key));
      }
    }
    const kept = new Set(), next = [from, to];
    while (next.length) {
      const key = next.pop();
      if (kept.has(key) || !found.has(key)) continue;
      kept.add(key);
      next.push(...found.get(key).joined);
    }
    return [...kept].map((key) => found.get(key)).sort((p, q) => p.distance - q.distance);
  };
  return { rim: those((s) => s.faces === 1), inner: those((s) => s.faces > 1 && !s.diagonal), cut };
};
