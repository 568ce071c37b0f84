// Looks at the pages in the frames of this one: what is drawn over something else or cut off.
const faultsOf = (page) => {
  const faults = [];
  for (const formula of page.querySelectorAll("div.math")) {
    const number = formula.querySelector(".eqno");
    const name = number ? number.textContent : formula.textContent.slice(0, 40);
    // the glyphs: the box of a formula may be narrower than what is in it
    const signs = [...formula.querySelectorAll("mi, mo, mn, mtext")];
    const glyphs = signs.map((x) => x.getBoundingClientRect()).filter((x) => x.width > 0);
    if (number) {
      const b = number.getBoundingClientRect();
      const meets = (a) =>
        a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
      if (glyphs.some(meets)) faults.push(`the number ${name} is drawn on its formula`);
    }
    const frame = formula.getBoundingClientRect();
    if (glyphs.some((a) => a.top < frame.top - 2 || a.bottom > frame.bottom + 2))
      faults.push(`the formula ${name} is cut off`);
  }
  for (const sign of page.querySelectorAll("math :is(mi, mo, mn, mtext)"))
    if (/[&\\]/.test(sign.textContent)) faults.push(`a formula has ${sign.textContent} as it is written`);
  const root = page.documentElement;
  if (root.scrollWidth > root.clientWidth + 1)
    faults.push(`it is ${root.scrollWidth - root.clientWidth} pixels wider than the window`);
  return faults;
};

addEventListener("load", () => {
  const found = [...document.querySelectorAll("iframe")].map((frame) => {
    const formulas = frame.contentDocument.querySelectorAll("div.math").length;
    return [frame.title, frame.width, formulas, faultsOf(frame.contentDocument)];
  });
  document.body.innerHTML = "";
  document.body.textContent = JSON.stringify(found);
});
