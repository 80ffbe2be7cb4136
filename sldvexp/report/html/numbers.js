// Numbers of the nodes: exact ones, or whole ones as differences from node to node, by bytes.
"use strict";
const bytes = (text) => Uint8Array.from(atob(text || ""), (c) => c.charCodeAt(0));
const floats = (text) => new Float32Array(bytes(text).buffer);
const integers = (text) => Uint32Array.from(new Uint16Array(bytes(text).buffer));

// Real parts, imaginary parts and bounds of the layers, by frequency, component and node.
const readNumbers = async (data, nodes) => {
  const NONE = data.look.none, components = data.components.length;
  const whole = async (text) => {
    const deflated = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
    const planes = new Uint8Array(await new Response(deflated).arrayBuffer()), count = planes.length / 2;
    const found = new Int16Array(count);
    for (let i = 0, sum = 0; i < count; i++) {
      sum = (i % nodes ? sum : 0) + (planes[i] | planes[count + i] << 8);
      found[i] = sum;
    }
    return found;
  };
  const stepped = async (text, step) =>
    Float32Array.from(await whole(text), (q, i) => q === NONE ? NaN : q * step(i));
  const velocities = async (own) => {
    if (!own.rounded) return { real: floats(own.real), imaginary: floats(own.imaginary), bound: floats(own.bound) };
    const bound = Float32Array.from(await whole(own.bound), (q) => q === NONE ? NaN : own.least * Math.exp(own.ratio * q));
    const step = (i) => {
      const finest = own.finest[Math.floor(i / (components * nodes))], share = own.share * bound[i];
      return share > finest ? share : finest;
    };
    return { real: await stepped(own.real, step), imaginary: await stepped(own.imaginary, step), bound };
  };
  const colouring = async (own) => {
    const of = async (text) => !text ? undefined
      : data.rounded ? stepped(text, (i) => own.finest[Math.floor(i / nodes)]) : floats(text);
    return { ...own, real: await of(own.real), imaginary: await of(own.imaginary) };
  };
  const position = floats(data.position), normal = floats(data.normal);
  const deep = (depth) => position.map((x, i) => x + depth * normal[i % normal.length]);
  const others = (data.layers || []).map(async (own) => ({ ...await velocities(own), position: deep(own.depth), first: own.first }));
  return {
    layers: [{ ...await velocities(data), position, first: data.first }, ...await Promise.all(others)],
    colourings: await Promise.all((data.colourings || []).map(colouring)),
  };
};
