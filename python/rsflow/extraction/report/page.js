(() => {
  "use strict";
  const all = (where, what) => [...where.querySelectorAll(what)];
  const made = (kind, name, parent) => {
    const one = document.createElement(kind);
    one.className = name;
    parent.append(one);
    return one;
  };
  const placesOf = (span) => Math.max(0, Math.min(8, 3 - Math.ceil(Math.log10(Math.max(span, 1e-12)))));
  const written = (value, places) => value.toFixed(places).replace("-", "\u2212");
  const short = (value, span) => written(value, placesOf(span));
  const points = (one) => (one.getAttribute("points") || "").trim().split(/\s+/).map((pair) => pair.split(",").map(Number));

  // The slider: one picture at a time.
  let go = null;
  for (const slider of all(document, ".slider")) {
    const figures = all(slider, "figure");
    if (figures.length < 2) continue;
    slider.classList.add("live");
    const strip = slider.querySelector(".strip");
    for (const name of ["tabindex", "role", "aria-label"]) strip.removeAttribute(name);
    for (const figure of figures) figure.querySelector("img").removeAttribute("loading");
    const bar = made("div", "bar", slider);
    const button = (text, label) => {
      const one = made("button", "", bar);
      one.type = "button";
      one.textContent = text;
      one.setAttribute("aria-label", label);
      return one;
    };
    const play = button("Play", "play the pictures");
    const back = button("\u2039", "picture before");
    const range = made("input", "", bar);
    range.type = "range";
    range.min = 0;
    range.max = figures.length - 1;
    range.setAttribute("aria-label", "frame");
    const on = button("\u203a", "next picture");
    const show = (number) => {
      const at = Math.max(0, Math.min(figures.length - 1, number));
      figures.forEach((figure, index) => { figure.hidden = index !== at; });
      range.value = at;
      range.setAttribute("aria-valuetext", figures[at].querySelector("figcaption").textContent);
    };
    let timer = 0;
    const stop = () => { clearInterval(timer); timer = 0; play.textContent = "Play"; };
    play.addEventListener("click", () => {
      if (timer) { stop(); return; }
      play.textContent = "Stop";
      timer = setInterval(() => show((Number(range.value) + 1) % figures.length), 250);
    });
    back.addEventListener("click", () => { stop(); show(Number(range.value) - 1); });
    on.addEventListener("click", () => { stop(); show(Number(range.value) + 1); });
    range.addEventListener("input", () => { stop(); show(Number(range.value)); });
    // It begins where most moves, of several such pictures with the one nearest to the middle.
    const things = figures.map((figure) => Number(figure.dataset.things));
    const most = Math.max(...things);
    const middle = (figures.length - 1) / 2;
    show(things.reduce((best, count, index) => count === most && (most || !index) && (best < 0 ||
      Math.abs(index - middle) < Math.abs(best - middle)) ? index : best, -1));
    go = (value, minutes, byFrame) => {
      const of = (figure) => byFrame ? Number(figure.dataset.frame) : Number(figure.dataset.t) / (minutes ? 60 : 1);
      stop();
      show(figures.reduce((best, figure, index) =>
        Math.abs(of(figure) - value) < Math.abs(of(figures[best]) - value) ? index : best, 0));
    };
  }

  // Plots: the values where the pointer is.
  for (const box of all(document, ".box[data-x]")) {
    const [x0, x1] = box.dataset.x.split(" ").map(Number);
    const [y0, y1] = box.dataset.y.split(" ").map(Number);
    const names = (box.dataset.names || "").split("|");
    const plane = "plane" in box.dataset;
    const xLabel = box.parentElement.nextElementSibling ? box.parentElement.nextElementSibling.textContent : "";
    const plot = box.closest(".plot");
    const ofY = plot && plot.querySelector(".unit") ? ` ${plot.querySelector(".unit").textContent}` : "";
    const unit = (/ in (\w+)$/.exec(xLabel) || ["", ""])[1];
    let curves = null;
    let bands = null;
    let pieces = null;
    let tip = null;
    const ready = () => {
      const lines = [0, 1, 2, 3].map((number) => all(box, `polyline.c${number}`).map(points));
      curves = lines.map((runs) => runs.flat());
      pieces = lines.map((runs) => runs.map((run) => [run[0][0], run[run.length - 1][0]]));
      bands = [0, 1, 2, 3].map((number) => all(box, `polygon.f${number}`).map(points));
      tip = { text: made("div", "tip", box), line: made("div", plane ? "dot" : "cursor", box) };
    };
    const leave = () => { if (tip) { tip.text.hidden = tip.line.hidden = true; } };
    const value = (y) => y1 + (y0 - y1) * y / 10000;
    const std = (number, x) => {
      // The upper outline of a band comes first, then the lower one, back.
      for (const band of bands[number]) {
        const half = band.length / 2;
        for (let index = 0; index < half; index += 1) {
          if (band[index][0] === x) return (value(band[index][1]) - value(band[band.length - 1 - index][1])) / 2;
        }
      }
      return NaN;
    };
    const line = (colour, text) => {
      const row = document.createElement("div");
      if (colour) made("i", colour, row);
      row.append(text);
      tip.text.append(row);
    };
    const nearest = (list, x) => list.reduce((best, point) =>
      Math.abs(point[0] - x) < Math.abs(best[0] - x) ? point : best, list[0]);
    const over = (event) => {
      if (!curves) ready();
      const area = box.getBoundingClientRect();
      const share = Math.max(0, Math.min(1, (event.clientX - area.left) / area.width));
      const down = (event.clientY - area.top) / area.height;
      tip.text.replaceChildren();
      let at = share;
      if (plane) {
        const near = curves[0].reduce((best, point) =>
          Math.hypot(point[0] / 1e4 - share, point[1] / 1e4 - down) <
          Math.hypot(best[0] / 1e4 - share, best[1] / 1e4 - down) ? point : best, curves[0][0]);
        if (!near) return;
        at = near[0] / 1e4;
        tip.line.style.left = `${100 * at}%`;
        tip.line.style.top = `${near[1] / 100}%`;
        line("", `x ${short(x0 + at * (x1 - x0), Math.abs(x1 - x0))} m`);
        line("", `y ${short(value(near[1]), Math.abs(y1 - y0))} m`);
      } else {
        const column = Math.max(10000 / area.width, 6);
        const x = share * 10000;
        line("", `${xLabel.split(" in ")[0]} ${short(x0 + share * (x1 - x0), x1 - x0)} ${unit}`);
        names.forEach((name, number) => {
          const list = curves[number];
          // Between two pieces of a curve nothing was measured, but for what is nearer to one than half a step.
          const beside = Math.max(2 * column, 5000 / Math.max(list.length, 1));
          const inside = pieces[number].some(([from, to]) => x >= from - beside && x <= to + beside);
          const near = inside ? nearest(list, x) : null;
          if (!near) { line(`b${number}`, `${name}: not measured`); return; }
          const here = list.filter((point) => Math.abs(point[0] - near[0]) < column).map((point) => value(point[1]));
          const low = Math.min(...here);
          const high = Math.max(...here);
          const span = y1 - y0;
          const off = std(number, near[0]);
          // As many places as the deviation allows, and the drawing has.
          const most = "whole" in box.dataset ? 0 : placesOf(span) + (off > 0 ? 1 : 0);
          const places = off > 0 ? Math.min(most, Math.max(0, -Math.floor(Math.log10(off * 1.05)))) : most;
          const text = high - low > span / 500 && list.length > 1200
            ? `${written(low, most)} to ${written(high, most)}`
            : written(value(near[1]), places) + (off > 0 ? ` \u00b1 ${written(off, places)}` : "");
          line(`b${number}`, `${name}: ${text}${ofY}`);
        });
        tip.line.style.left = `${100 * share}%`;
      }
      tip.text.hidden = tip.line.hidden = false;
      const room = area.width - tip.text.offsetWidth;
      const beside = at * area.width + 12;
      tip.text.style.left = `${Math.max(0, beside > room ? Math.min(room, at * area.width - tip.text.offsetWidth - 12) : beside)}px`;
    };
    box.addEventListener("pointermove", over);
    box.addEventListener("pointerdown", over);
    box.addEventListener("pointerleave", leave);
    if (!plane) {
      box.addEventListener("click", (event) => {
        const area = box.getBoundingClientRect();
        const share = (event.clientX - area.left) / area.width;
        if (go) go(x0 + share * (x1 - x0), unit === "min", unit === "");
      });
    }
  }

  // A row of the table of things shows its way alone.
  const ways = all(document, ".way");
  for (const row of all(document, "tr[data-thing]")) {
    const own = ways.filter((way) => way.dataset.thing === row.dataset.thing);
    const pick = (on) => {
      for (const way of own) {
        way.classList.toggle("on", on);
        way.ownerSVGElement.classList.toggle("picked", on);
      }
    };
    row.addEventListener("pointerenter", () => pick(true));
    row.addEventListener("pointerleave", () => pick(false));
  }
})();
