// Two shapes beside each other: what is chosen of one is chosen of the other.
"use strict";
SHAPES.then((shapes) => {
  const [first, second] = shapes.filter((shape) => shape && shape.root.closest(".beside"));
  if (!first || !second) return;
  let following = false;
  const follow = (act) => (...given) => {
    if (following) return;
    following = true;
    act(...given);
    following = false;
  };
  const CHOSEN = ["component", "colour", "glyph", "shell", "phase", "size", "speed", "view", "node", "from", "to", "layer"];
  const TICKED = ["fade", "rest", "flat", "common", "logarithmic", "stands"];
  for (const [one, other] of [[first, second], [second, first]]) {
    const tell = (key, set) => one.control(key).addEventListener("input", follow(() => {
      const there = other.control(key);
      if (set(one.control(key), there)) there.dispatchEvent(new Event("input"));
    }));
    for (const key of CHOSEN) {
      tell(key, (here, there) => {
        if (there.options && ![...there.options].some((option) => option.value === here.value)) return false;
        there.value = here.value;
        return true;
      });
    }
    for (const key of TICKED) tell(key, (here, there) => { there.checked = here.checked; return true; });
    one.played = follow((playing) => {
      other.state.phase = one.state.phase;
      other.play(playing);
    });
    one.arranged = follow(() => {
      const { azimuth, elevation, distance, shift } = one.camera;
      other.look_from({ azimuth, elevation, distance, shift: [...shift] });
    });
    one.tuned = follow((frequency) => { if (one.partners) other.tune(one.partners[frequency]); });
  }
  second.state.phase = first.state.phase;
});
