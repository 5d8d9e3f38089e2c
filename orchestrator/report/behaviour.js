"use strict";
(function () {
  const page = JSON.parse(document.getElementById("payload").textContent);
  const root = document.documentElement;
  const numbers = { f8: Float64Array, f4: Float32Array, i4: Int32Array, i2: Int16Array };
  const arrays = page.arrays.map(function (packed) {
    const text = atob(packed.bdata);
    const bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    return new numbers[packed.dtype](bytes.buffer);
  });
  const token = /^\$([a-z]+\d?)(?:\/(\d+))?$/;
  const coarse = matchMedia("(pointer: coarse)").matches;
  const figures = page.figures.map(function (figure) {
    const frame = document.getElementById("figure-" + figure.name);
    return { ...figure, frame: frame, plot: frame.querySelector(".plot"), off: new Set(), seen: new Set() };
  });

  function theme() { return root.dataset.theme; }

  function shown(value, palette) {
    if (typeof value === "string") {
      const match = token.exec(value);
      if (!match || !(match[1] in palette)) return value;
      const hex = palette[match[1]];
      if (!match[2]) return hex;
      const parts = [1, 3, 5].map(function (at) { return parseInt(hex.slice(at, at + 2), 16); });
      return "rgba(" + parts.join(",") + "," + match[2] / 100 + ")";
    }
    if (Array.isArray(value)) return value.map(function (item) { return shown(item, palette); });
    if (value && typeof value === "object") {
      if ("array" in value && typeof value.array === "number") return arrays[value.array];
      return Object.fromEntries(Object.entries(value).map(function (entry) {
        return [entry[0], shown(entry[1], palette)];
      }));
    }
    return value;
  }

  function merged(base, more) {
    const result = { ...base };
    for (const key of Object.keys(more)) {
      const plain = function (value) { return value && typeof value === "object" && !Array.isArray(value); };
      result[key] = plain(more[key]) && plain(result[key]) ? merged(result[key], more[key]) : more[key];
    }
    return result;
  }

  function group(trace) { return trace.legendgroup || trace.name; }

  function view(figure) {
    const chosen = Array.from(figure.frame.querySelectorAll("select"), function (select) { return select.value; });
    return figure.views[chosen.join("|")];
  }

  function draw(figure) {
    const palette = page.palettes[theme()];
    const current = view(figure);
    for (const trace of current.traces) {
      if (trace.visible === "legendonly" && !figure.seen.has(group(trace))) figure.off.add(group(trace));
      figure.seen.add(group(trace));
    }
    const data = shown(current.traces, palette).map(function (trace) {
      return { ...trace, visible: !figure.off.has(group(trace)) };
    });
    const layout = shown(merged(figure.layout, current.layout), palette);
    layout.template = { layout: shown(page.template, palette) };
    layout.height = figure.aspect ? Math.round(figure.plot.clientWidth * figure.aspect) : figure.height;
    if (coarse) layout.dragmode = false;
    const config = {
      responsive: true, displaylogo: false, displayModeBar: coarse ? false : "hover",
      modeBarButtonsToRemove: ["lasso2d", "select2d"],
      toImageButtonOptions: { filename: figure.name, format: "svg" },
    };
    legend(figure, current.traces, palette);
    return Plotly.react(figure.plot, data, layout, config);
  }

  function swatch(trace, palette) {
    const line = trace.line || {};
    const marker = trace.marker || {};
    const colour = function (value, otherwise) {
      return typeof value === "string" ? shown(value, palette) : otherwise;
    };
    const dashes = { dash: "5 3", dot: "1.5 3", dashdot: "5 2 1.5 2", longdash: "8 3" };
    const mode = trace.mode || (trace.type === "scatter" ? "lines" : "markers");
    let parts = "";
    if (trace.fill) parts += '<rect x="1" y="1" width="20" height="10" rx="2" fill="' + colour(trace.fillcolor, "currentColor") + '"/>';
    if (mode.includes("lines") && line.width !== 0) {
      parts += '<line x1="1" y1="6" x2="21" y2="6" stroke-width="' + Math.min(line.width || 2, 4) + '" stroke="' + colour(line.color, "currentColor") +
        '" stroke-dasharray="' + (dashes[line.dash] || "none") + '"/>';
    }
    if (mode.includes("markers") && !trace.fill) {
      const symbol = typeof marker.symbol === "string" ? marker.symbol : "circle";
      const edge = marker.line && marker.line.width ? ' stroke="' + colour(marker.line.color, "none") + '" stroke-width="1.5"' : "";
      const fill = colour(marker.color, "currentColor");
      if (symbol.startsWith("x")) parts += '<path d="M7 2l8 8M15 2l-8 8" stroke-width="2" stroke="' + fill + '"/>';
      else if (symbol.startsWith("square")) parts += '<rect x="6.5" y="1.5" width="9" height="9" fill="' + fill + '"' + edge + "/>";
      else if (symbol.startsWith("diamond")) parts += '<path d="M11 0l6 6-6 6-6-6z" fill="' + fill + '"' + edge + "/>";
      else if (symbol.startsWith("arrow")) parts += '<path d="M6 1.5h10M11 2l4.5 8.5L11 8.5 6.5 10.5z" stroke-width="1.5" stroke="' + fill + '" fill="' + fill + '"/>';
      else if (symbol.startsWith("triangle")) parts += '<path d="M11 1l6 10H5z" fill="' + fill + '"' + edge + "/>";
      else if (symbol.endsWith("open")) parts += '<circle cx="11" cy="6" r="4.5" fill="none" stroke-width="2" stroke="' + fill + '"/>';
      else parts += '<circle cx="11" cy="6" r="4.5" fill="' + fill + '"' + edge + "/>";
    }
    return '<svg viewBox="0 0 22 12" aria-hidden="true">' + parts + "</svg>";
  }

  function legend(figure, traces, palette) {
    const place = figure.frame.querySelector(".legend");
    const focused = place.contains(document.activeElement) ? document.activeElement.dataset.group : null;
    const names = new Map();
    for (const trace of traces) {
      if (trace.name && trace.showlegend !== false && !names.has(group(trace))) names.set(group(trace), trace);
    }
    place.replaceChildren();
    if (names.size < 2) return;
    for (const [name, trace] of names) {
      const button = document.createElement("button");
      button.type = "button";
      button.dataset.group = name;
      button.setAttribute("aria-pressed", String(!figure.off.has(name)));
      button.innerHTML = swatch(trace, palette);
      button.append(trace.name);
      button.addEventListener("click", function () {
        if (!figure.off.delete(name)) figure.off.add(name);
        draw(figure);
      });
      place.append(button);
      if (name === focused) button.focus();
    }
    if (names.size > 6) {
      for (const all of [false, true]) {
        const button = document.createElement("button");
        button.type = "button";
        button.className = "many";
        button.textContent = all ? "show all" : "hide all";
        button.addEventListener("click", function () {
          for (const name of names.keys()) all ? figure.off.delete(name) : figure.off.add(name);
          draw(figure);
        });
        place.prepend(button);
      }
    }
  }

  function drawAll() { return figures.reduce(function (before, figure) {
    return before.then(function () { return draw(figure); });
  }, Promise.resolve()); }

  const button = document.getElementById("theme");
  function tell() {
    button.setAttribute("aria-pressed", String(theme() === "dark"));
    button.textContent = theme() === "dark" ? "Light page" : "Dark page";
  }
  button.addEventListener("click", function () {
    root.dataset.theme = theme() === "dark" ? "light" : "dark";
    try { localStorage.setItem("gauntlet-theme", theme()); } catch (error) { root.dataset.unsaved = "true"; }
    tell();
    drawAll();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", function (event) {
    root.dataset.theme = event.matches ? "dark" : "light";
    tell();
    drawAll();
  });
  for (const figure of figures) {
    for (const select of figure.frame.querySelectorAll("select")) {
      select.addEventListener("change", function () { draw(figure); });
    }
  }
  let width = root.clientWidth;
  addEventListener("resize", function () {
    if (root.clientWidth === width) return;
    width = root.clientWidth;
    for (const figure of figures) if (figure.aspect) draw(figure);
  });
  let before = null;
  addEventListener("beforeprint", function () {
    before = theme();
    for (const fold of document.querySelectorAll("details")) fold.open = true;
    if (before === "dark") { root.dataset.theme = "light"; figures.forEach(draw); }
  });
  addEventListener("afterprint", function () {
    if (before === "dark") { root.dataset.theme = "dark"; drawAll(); }
  });
  tell();
  drawAll().then(function () { root.dataset.drawn = "true"; });
})();
