// The shape with what is written around it, as a file.
"use strict";
const savePicture = (plot, map) => {
  const ratio = window.devicePixelRatio || 1, box = plot.getBoundingClientRect();
  const whole = document.createElement("canvas"), pen = whole.getContext("2d");
  [whole.width, whole.height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
  pen.scale(ratio, ratio);
  const behind = (part) => {
    const own = part ? getComputedStyle(part).backgroundColor : "#fff";
    return part && own === "rgba(0, 0, 0, 0)" ? behind(part.parentElement) : own;
  };
  pen.fillStyle = behind(plot);
  pen.fillRect(0, 0, box.width, box.height);
  const within = (element) => {
    const own = element.getBoundingClientRect();
    return [own.left - box.left, own.top - box.top, own.width, own.height];
  };
  const canvas = plot.querySelector("canvas");
  pen.drawImage(canvas, ...within(canvas));
  const [left, top, width, height] = within(plot.querySelector(".shape-bar-scale")), upright = height > width;
  const shades = pen.createLinearGradient(left, upright ? top + height : top, upright ? left : left + width, top);
  for (let i = 0; i < map.length; i += 3) {
    shades.addColorStop(i / (map.length - 3), `rgb(${map[i]},${map[i + 1]},${map[i + 2]})`);
  }
  pen.fillStyle = shades;
  pen.fillRect(left, top, width, height);
  pen.textBaseline = "middle";
  for (const text of plot.querySelectorAll(".shape-labels span, .shape-bar-ticks span, .shape-bar-title")) {
    const [x, y, , tall] = within(text), look = getComputedStyle(text);
    pen.fillStyle = look.color;
    pen.font = look.fontSize + " " + look.fontFamily;
    pen.fillText(text.textContent, x, y + tall / 2);
  }
  whole.toBlob((blob) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = "shape.png";
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  });
};
