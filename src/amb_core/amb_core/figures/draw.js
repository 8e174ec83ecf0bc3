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
// On paper a chart is as wide as the text of an A4 page, and not higher than it.
const PAPER = { width: 670, height: 820 }; // CSS pixels
const charts = [...waiting.keys()];
addEventListener("beforeprint", () => {
  charts.forEach((chart) => {
    draw(chart);
    const height = Math.min(PAPER.height, chart.layout.height);
    chart.screen = { height: chart.layout.height };
    Plotly.relayout(chart, { width: PAPER.width, height });
  });
});
addEventListener("afterprint", () => {
  charts.forEach((chart) => Plotly.relayout(chart, { width: null, autosize: true, ...chart.screen }));
});
