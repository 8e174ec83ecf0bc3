
// Rows of a table that a reader filters: those with the chosen text in each column.
document.querySelectorAll("form.filters").forEach((form) => {
  const rows = [...form.nextElementSibling.querySelectorAll("tbody tr")];
  const choices = [...form.querySelectorAll("select")];
  const show = () => {
    rows.forEach((row) => {
      row.hidden = choices.some(
        (choice) => choice.value && row.cells[Number(choice.dataset.column)].textContent.trim() !== choice.value,
      );
    });
    const shown = rows.filter((row) => !row.hidden).length;
    form.querySelector("output").textContent =
      shown === rows.length ? `${rows.length} rows` : `${shown} of ${rows.length} rows`;
  };
  form.addEventListener("change", show);
  form.addEventListener("submit", (event) => event.preventDefault());
});

// The contents mark the section that is being read.
const links = new Map(
  [...document.querySelectorAll("nav a")].map((link) => [decodeURIComponent(link.hash.slice(1)), link]),
);
const reading = new IntersectionObserver(
  (entries) =>
    entries.forEach((entry) => {
      const link = links.get(entry.target.querySelector("h2").id);
      if (entry.isIntersecting) link.setAttribute("aria-current", "true");
      else link.removeAttribute("aria-current");
    }),
  { rootMargin: "-30% 0px -65% 0px" },
);
document.querySelectorAll("main > section").forEach((section) => reading.observe(section));
