// The library reads what it writes on canvases again and again; a browser warns unless it is told.
(() => {
  const canvas = HTMLCanvasElement.prototype, context = canvas.getContext;
  canvas.getContext = function (kind, options) {
    return context.call(this, kind, kind === "2d" ? { willReadFrequently: true, ...options } : options);
  };
})();
