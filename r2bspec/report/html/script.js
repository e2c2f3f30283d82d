"use strict";
// Zoom and hover for the charts. The page is complete without it.
(() => {
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.hidden = true;
  tip.setAttribute("aria-hidden", "true");
  document.body.append(tip);

  // Of a page of histories: the results of each, in the order of time.
  const names = [];

  const number = (value) => Number(value.toPrecision(3)).toLocaleString("en");
  const said = (value, unit) => {
    if (unit === "percentile") return `${Number(((1 - 1 / value) * 100).toFixed(3))} % at or below`;
    if (unit.startsWith("result ")) return names[unit.slice(7)][Math.round(value)];
    if (unit === "message") return `message ${Math.round(value)}`;
    return `${number(value)} ${unit}`;
  };

  // From a position in the drawing to a value on an axis.
  const value = (at, from, to, [low, high, scale]) => {
    const share = (at - from) / (to - from);
    if (scale !== "log") return low + share * (high - low);
    return Math.exp(Math.log(low) + share * (Math.log(high) - Math.log(low)));
  };

  const points = (group) => {
    const found = [];
    for (const path of group.querySelectorAll(":scope > path")) {
      const numbers = path.getAttribute("d").match(/-?[\d.]+/g) || [];
      for (let i = 0; i + 1 < numbers.length; i += 2) found.push([+numbers[i], +numbers[i + 1]]);
    }
    for (const use of group.querySelectorAll("use")) {
      found.push([+use.getAttribute("x"), +use.getAttribute("y")]);
    }
    return found;
  };

  const nearest = (chart, x, y) => {
    let best = null;
    for (const { label, places } of chart.series) {
      for (const [px, py] of places) {
        const far = Math.hypot(px - x, py - y);
        if (far < 14 && (best === null || far < best.far)) best = { far, px, py, label };
      }
    }
    return best;
  };

  const hover = (chart, event) => {
    const place = new DOMPoint(event.clientX, event.clientY)
      .matrixTransform(chart.svg.getScreenCTM().inverse());
    const found = nearest(chart, place.x, place.y);
    const axes = found && chart.axes.find(({ box }) =>
      found.px >= box[0] - 1 && found.px <= box[2] + 1 && found.py >= box[1] - 1 && found.py <= box[3] + 1);
    tip.hidden = !axes;
    if (!axes) return;
    const [x0, y0, x1, y1] = axes.box;
    tip.textContent = `${found.label}: ${said(value(found.px, x0, x1, axes.x), axes.x[3])}, `
      + said(value(found.py, y1, y0, axes.y), axes.y[3]);
    tip.style.left = `${Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 4)}px`;
    tip.style.top = `${Math.max(event.clientY - 34, 4)}px`;
  };

  const zoomable = (chart) => {
    const { svg } = chart;
    const whole = svg.getAttribute("viewBox").split(/\s+/).map(Number);
    let view = [...whole];
    const set = ([x, y, w, h]) => {
      w = Math.min(Math.max(w, whole[2] / 20), whole[2]);
      h = w * whole[3] / whole[2];
      x = Math.min(Math.max(x, whole[0]), whole[0] + whole[2] - w);
      y = Math.min(Math.max(y, whole[1]), whole[1] + whole[3] - h);
      view = w < whole[2] ? [x, y, w, h] : [...whole];
      svg.setAttribute("viewBox", view.join(" "));
    };
    const zoom = (factor, cx = view[0] + view[2] / 2, cy = view[1] + view[3] / 2) =>
      set([cx - (cx - view[0]) * factor, cy - (cy - view[1]) * factor, view[2] * factor, view[3] * factor]);
    const move = (dx, dy) => set([view[0] + dx * view[2], view[1] + dy * view[3], view[2], view[3]]);
    const keys = {
      "+": () => zoom(0.7), "=": () => zoom(0.7), "-": () => zoom(1 / 0.7), "0": () => set([...whole]),
      ArrowLeft: () => move(-0.1, 0), ArrowRight: () => move(0.1, 0),
      ArrowUp: () => move(0, -0.1), ArrowDown: () => move(0, 0.1),
    };
    svg.setAttribute("tabindex", "0");
    svg.addEventListener("keydown", (event) => {
      const zoomed = view[2] < whole[2];
      if (event.ctrlKey || event.metaKey || !(event.key in keys)) return;
      if (event.key.startsWith("Arrow") && !zoomed) return;
      event.preventDefault();
      keys[event.key]();
    });
    svg.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      const place = new DOMPoint(event.clientX, event.clientY)
        .matrixTransform(svg.getScreenCTM().inverse());
      zoom(event.deltaY > 0 ? 1 / 0.85 : 0.85, place.x, place.y);
    }, { passive: false });
    let grip = null;
    svg.addEventListener("pointerdown", (event) => {
      if (view[2] < whole[2]) grip = [event.clientX, event.clientY];
    });
    addEventListener("pointerup", () => { grip = null; });
    svg.addEventListener("pointermove", (event) => {
      if (!grip) return hover(chart, event);
      tip.hidden = true;
      const wide = svg.clientWidth || 1;
      const high = svg.clientHeight || 1;
      move((grip[0] - event.clientX) / wide, (grip[1] - event.clientY) / high);
      grip = [event.clientX, event.clientY];
    });
    svg.addEventListener("pointerleave", () => { tip.hidden = true; });
    const tools = document.createElement("div");
    tools.className = "tools";
    for (const [text, name, key] of [["+", "Zoom in", "+"], ["−", "Zoom out", "-"], ["⟲", "Whole chart", "0"]]) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = text;
      button.setAttribute("aria-label", `${name}: ${chart.name}`);
      button.addEventListener("click", () => keys[key]());
      tools.append(button);
    }
    svg.parentElement.prepend(tools);
  };

  for (const svg of document.querySelectorAll("svg.chart")) {
    // Remove the browser's own tooltip, which would cover ours; its text stays the name.
    const title = svg.querySelector(":scope > title");
    const name = title ? title.textContent : "";
    svg.setAttribute("aria-label", name);
    svg.removeAttribute("aria-labelledby");
    title?.remove();
    zoomable({
      svg, name,
      axes: JSON.parse(svg.dataset.axes || "[]"),
      series: [...svg.querySelectorAll("g[data-label]")].map((group) =>
        ({ label: group.dataset.label, places: points(group) })),
    });
  }

  addEventListener("beforeprint", () => {
    for (const each of document.querySelectorAll("details")) each.open = true;
  });
})();
