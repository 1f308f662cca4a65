// The documentation site in a frame, with its own navigation and search.
import { api, h } from "./lib.js";

export const show = async (container) => {
  const { there } = await api("/api/docs");
  if (!there) {
    container.replaceChildren(
      h("p", { class: "statement warn" }, "This installation has no documentation in it."),
      h("p", {}, "In a checkout ", h("code", {}, "make site"), " builds it."),
    );
    return;
  }
  container.replaceChildren(h("iframe", { class: "docs", src: "/docs/index.html", title: "Documentation" }));
};
