// The colours before the first picture is drawn: a page in red light must not flash white when it is loaded again.
(() => {
  let wanted = null;
  try { wanted = localStorage.getItem("sunglint-theme"); } catch { /* this browser keeps nothing */ }
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const theme = ["light", "dark", "red"].includes(wanted) ? wanted : dark ? "dark" : "light";
  document.documentElement.dataset.theme = theme;
  document.querySelector("meta[name='color-scheme']").content = theme === "light" ? "light" : "dark";
})();
