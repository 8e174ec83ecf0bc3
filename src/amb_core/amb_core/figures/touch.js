// A finger that scrolls the page must not zoom the chart that it touches.
if (matchMedia("(pointer: coarse)").matches)
  document.querySelectorAll(".plotly-graph-div").forEach((chart) => Plotly.relayout(chart, {dragmode: false}));
