// The colours before the first picture is drawn: a page in red light must not flash white when it is loaded again.
(() => {
  let wanted = null;
  try { wanted = localStorage.getItem("sunglint-theme"); } catch { /* this browser keeps nothing */ }
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const theme = ["light", "dark", "red"].includes(wanted) ? wanted : dark ? "dark" : "light";
  document.documentElement.dataset.theme = theme;
  document.querySelector("meta[name='color-scheme']").content = theme === "light" ? "light" : "dark";
})();

// A file of the page that did not come (a busy computer, a connection that broke) is asked for again: without its style a page in red light is white, and without
// its program it says "connecting" for ever.
(() => {
  const most = 6;
  let asked = 0;
  const reloads = () => { try { return Number(sessionStorage.getItem("sunglint-reloads") ?? most); } catch { return most; } };
  addEventListener("error", ({ target }) => {
    if (target instanceof HTMLLinkElement && target.rel === "stylesheet" && asked < most) {
      asked += 1;
      setTimeout(() => target.replaceWith(target.cloneNode()), 500 * asked);
    } else if (target instanceof HTMLScriptElement && reloads() < most) {
      sessionStorage.setItem("sunglint-reloads", reloads() + 1);
      setTimeout(() => location.reload(), 1000);
    }
  }, true);
  try { if (sessionStorage.getItem("sunglint-reloads") === null) sessionStorage.setItem("sunglint-reloads", 0); } catch { /* then it is not loaded again by itself */ }
})();
