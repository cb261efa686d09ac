// Sets the equations of a page as MathML, which browsers draw with fonts of their own.
document$.subscribe(() => {
  for (const element of document.querySelectorAll(".arithmatex")) {
    const text = element.textContent.trim();
    katex.render(text.slice(2, -2), element, {
      displayMode: text.startsWith("\\["),
      output: "mathml",
      throwOnError: true,
    });
  }
});
