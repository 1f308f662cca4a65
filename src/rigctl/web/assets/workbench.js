import { h } from "./lib.js";

export const show = async (place) => {
  place.replaceChildren(h("p", { class: "note" }, "Nothing is shown here yet."));
};
