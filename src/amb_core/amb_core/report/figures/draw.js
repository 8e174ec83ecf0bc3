// Charts are drawn when they come near the window, then one after another while the page is idle: a long page is readable
// at once, and complete when it is searched or printed.
const waiting = new Map(
  [...document.querySelectorAll("script.figure")].map((data) => [
    data.previousElementSibling.querySelector(".plotly-graph-div"),
    data,
  ]),
);
const draw = (chart) => {
  const data = waiting.get(chart);
  if (!data || !waiting.delete(chart)) return;
  near.unobserve(chart);
  const figure = JSON.parse(data.textContent);
  // A finger that scrolls the page must not zoom the chart that it touches.
  if (matchMedia("(pointer: coarse)").matches) figure.layout.dragmode = false;
  Plotly.newPlot(chart, figure.data, figure.layout, figure.config);
};
const near = new IntersectionObserver(
  (entries) => entries.filter((entry) => entry.isIntersecting).forEach((entry) => draw(entry.target)),
  { rootMargin: "50% 0px" },
);
const drawNext = () => {
  if (!waiting.size) return;
  draw(waiting.keys().next().value);
  setTimeout(drawNext, 50);
};
waiting.forEach((_data, chart) => near.observe(chart));
addEventListener("load", () => setTimeout(drawNext, 500));
// On paper a chart is as wide as the text of an A4 page, leaves room for its caption, and has smaller letters.
const PAPER = { width: 670, height: 820, letters: 11 }; // CSS pixels
const charts = [...waiting.keys()];
const fit = (chart, layout) => {
  chart.style.height = `${layout.height}px`;
  Plotly.relayout(chart, layout);
};
const screens = new Map();
addEventListener("beforeprint", () => {
  charts.forEach((chart) => {
    draw(chart);
    const { height, font } = chart.layout;
    screens.set(chart, { height, width: null, autosize: true, "font.size": font.size });
    fit(chart, { height: Math.min(PAPER.height, height), width: PAPER.width, "font.size": PAPER.letters });
  });
});
addEventListener("afterprint", () => screens.forEach((layout, chart) => fit(chart, layout)));
