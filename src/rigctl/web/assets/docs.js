// The documentation site in a frame, with its own navigation and search; without it, the pages as they are written.
import { api, complain, h } from "./lib.js";

export const show = async (container) => {
  const { there, pages } = await api("/api/docs");
  if (!there && pages.length) {
    const text = h("pre", { class: "written", tabindex: 0 });
    const open = async (path) => {
      text.textContent = await (await fetch(`/docs/${path}`)).text();
      text.scrollIntoView({ block: "nearest" });
    };
    const links = pages.map(({ path, title }) => h("li", {}, h("a", { href: `/docs/${path}`, onclick: (event) => (event.preventDefault(), open(path).catch(complain)) }, title)));
    container.replaceChildren(h("ul", { class: "written" }, ...links), text);
    await open(pages[0].path);
    return;
  }
  if (!there) {
    container.replaceChildren(
      h("p", { class: "statement warn" }, "This installation has no documentation in it."),
      h("p", {}, "In a checkout ", h("code", {}, "make site"), " builds it."),
    );
    return;
  }
  container.replaceChildren(h("iframe", { class: "docs", src: "/docs/index.html", title: "Documentation" }));
};
