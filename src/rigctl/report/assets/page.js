// Draws the page's plots from the numbers that stand beside them: each one when it comes into view.
"use strict";
(() => {
  const config = { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["select2d", "lasso2d"] };
  const drawn = new Set();
  const paper = window.matchMedia("print");
  const dark = window.matchMedia("(prefers-color-scheme: dark)");

  const decode = (text) =>
    new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);

  // the numbers of the traces; an x given as a number is that of an earlier trace
  const unpack = (arrays) => {
    const xs = [];
    for (const x of arrays.x) xs.push(typeof x === "number" ? xs[x] : decode(x));
    return arrays.y.map((y, i) => ({ x: xs[i], y: decode(y) }));
  };

  const read = (attribute, key) =>
    JSON.parse(document.querySelector(`script[data-${attribute}="${CSS.escape(key)}"]`).textContent);

  const theme = (layout) => {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    const themed = {
      ...layout,
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: colour("--text") },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("--quiet"), activecolor: colour("--accent") },
      hoverlabel: { bgcolor: colour("--raised"), bordercolor: colour("--line"), font: { color: colour("--text") } },
    };
    for (const name of Object.keys(layout).filter((key) => /^[xy]axis/.test(key))) {
      const lines = { gridcolor: colour("--grid"), linecolor: colour("--line"), zerolinecolor: colour("--line") };
      themed[name] = { ...layout[name], ...lines, automargin: name[0] === "y" ? "left" : false };
    }
    themed.xaxis = { ...themed.xaxis, showspikes: true, spikemode: "across", spikethickness: 1, spikedash: "solid", spikecolor: colour("--quiet") };
    return themed;
  };

  // on a narrow screen the legend goes below, and the buttons, which need a mouse, go away
  const fitted = (place, layout) => {
    if (place.clientWidth >= 640) return [layout, config];
    const margin = { ...layout.margin, l: 56, t: 8 };
    const below = 66 / Math.max(layout.height - margin.t - margin.b, 1); // the axis' numbers and its title
    const legend = { ...layout.legend, y: -below, yanchor: "top" };
    return [{ ...layout, legend, margin }, { ...config, displayModeBar: false }];
  };

  const paint = (place) => {
    const [layout, settings] = fitted(place, place.figure.layout);
    return Plotly.react(place, place.figure.data, theme(layout), settings);
  };

  const draw = (place, figure) => {
    place.style.minHeight = `${figure.height}px`;
    place.figure = figure;
    drawn.add(place);
    return paint(place);
  };

  const drawSlot = (place) => {
    if (drawn.has(place)) return;
    const figure = read("figure", place.id);
    const numbers = unpack(figure.arrays);
    draw(place, { ...figure, data: figure.data.map((trace, i) => ({ ...trace, ...numbers[i] })) });
  };

  const chosen = document.getElementById("record-chosen");
  const other = document.getElementById("record-other");
  const sameScales = document.getElementById("record-scales");
  const recordPlace = document.getElementById("record-plot");

  const tracesOf = (key) => {
    const template = read("template", key.split("-")[0]);
    const numbers = unpack(read("record", key));
    return { ...template, data: template.data.map((trace, i) => ({ ...trace, ...numbers[i] })) };
  };

  const withOwnScales = (layout) => {
    const own = { ...layout };
    for (const name of Object.keys(layout).filter((key) => key.startsWith("yaxis") && !layout[key].tickvals)) {
      const { range, ...rest } = layout[name];
      own[name] = rest;
    }
    return own;
  };

  const axesByTitle = (layout) =>
    new Map(
      Object.keys(layout)
        .filter((name) => name.startsWith("yaxis"))
        .map((name) => [layout[name].title.text, name.replace("yaxis", "y")]),
    );

  const drawRecord = () => {
    const figure = tracesOf(chosen.value);
    if (!sameScales.checked) figure.layout = withOwnScales(figure.layout);
    if (other.value) {
      const second = tracesOf(other.value);
      const axes = axesByTitle(figure.layout);
      for (const trace of second.data) {
        const title = second.layout[trace.yaxis.replace("y", "yaxis")].title.text;
        if (!axes.has(title)) continue; // another bench, which has a channel more
        figure.data.push({
          ...trace,
          yaxis: axes.get(title),
          name: `${trace.name} (compared)`,
          line: { ...trace.line, dash: "dash" },
          opacity: 0.75,
          showlegend: false,
        });
      }
    }
    document.getElementById("record-title").textContent =
      chosen.selectedOptions[0].textContent +
      (other.value ? `, dashed: ${other.selectedOptions[0].textContent}` : "");
    for (const row of document.querySelectorAll("[data-choose]"))
      row.classList.toggle("chosen", row.dataset.choose === chosen.value);
    return draw(recordPlace, figure);
  };

  const choose = (key) => {
    if (![...chosen.options].some((option) => option.value === key)) return;
    chosen.value = key;
    drawRecord();
  };

  const step = (by) => {
    const index = chosen.selectedIndex + by;
    if (index >= 0 && index < chosen.options.length) choose(chosen.options[index].value);
  };

  const drawAny = (place) => {
    if (place !== recordPlace) drawSlot(place);
    else if (!drawn.has(place)) drawRecord();
  };

  const redraw = () => {
    for (const place of drawn) paint(place);
  };

  // a link into what is folded opens it
  const unfold = () => {
    const target = location.hash && document.getElementById(location.hash.slice(1).split("/")[0]);
    if (!target) return;
    const within = [...target.querySelectorAll(":scope > details.fold")];
    for (let one = target.closest("details"); one; one = one.parentElement.closest("details")) within.push(one);
    for (const fold of within) fold.open = true;
    if (within.length) target.scrollIntoView();
  };
  window.addEventListener("hashchange", unfold);
  for (const link of document.querySelectorAll('a[href^="#"]')) link.addEventListener("click", () => setTimeout(unfold));
  unfold();

  // a table that is wider than the page is scrolled by keys too
  const wide = () => {
    for (const box of document.querySelectorAll(".scroll")) {
      const scrolls = box.scrollWidth > box.clientWidth + 1 || box.scrollHeight > box.clientHeight + 1;
      const name = box.querySelector("caption, th");
      box.toggleAttribute("tabindex", scrolls);
      if (scrolls) {
        box.tabIndex = 0;
        box.setAttribute("role", "region");
        box.setAttribute("aria-label", name ? name.textContent.trim().slice(0, 120) : "table");
      } else {
        box.removeAttribute("role");
        box.removeAttribute("aria-label");
      }
    }
  };
  window.addEventListener("resize", wide);
  for (const fold of document.querySelectorAll("details")) fold.addEventListener("toggle", wide);
  wide();

  const places = [...document.querySelectorAll(".plot")];
  const watcher = new IntersectionObserver(
    (entries) => {
      for (const entry of entries.filter((candidate) => candidate.isIntersecting)) {
        watcher.unobserve(entry.target);
        drawAny(entry.target);
      }
    },
    { rootMargin: "400px" },
  );
  places.forEach((place) => watcher.observe(place));

  if (chosen) {
    const followLink = () => {
      const match = /^#records\/(r\d+-\d+)$/.exec(location.hash);
      if (match) {
        choose(match[1]);
        document.getElementById("records").scrollIntoView();
      }
    };
    chosen.addEventListener("change", drawRecord);
    other.addEventListener("change", drawRecord);
    sameScales.addEventListener("change", drawRecord);
    document.getElementById("record-previous").addEventListener("click", () => step(-1));
    document.getElementById("record-next").addEventListener("click", () => step(1));
    document.addEventListener("keydown", (event) => {
      const typing = event.target.tagName === "SELECT";
      const held = event.altKey || event.ctrlKey || event.metaKey || event.shiftKey;
      if (typing || held || !["ArrowLeft", "ArrowRight"].includes(event.key)) return;
      step(event.key === "ArrowLeft" ? -1 : 1);
      event.preventDefault();
    });
    for (const row of document.querySelectorAll("[data-choose]"))
      row.addEventListener("click", () => choose(row.dataset.choose));
    window.addEventListener("hashchange", followLink);
    followLink();
  }

  dark.addEventListener("change", redraw);
  // on paper every plot is there, dark on white
  paper.addEventListener("change", redraw);
  const closed = [];
  window.addEventListener("beforeprint", () => {
    for (const fold of document.querySelectorAll("details.fold:not([open])")) {
      closed.push(fold);
      fold.open = true;
    }
    places.forEach(drawAny);
    redraw();
  });
  window.addEventListener("afterprint", () => {
    for (const fold of closed.splice(0)) fold.open = false;
    redraw();
  });
})();
