// The frame of a part: authenticates the browser, shows the project, and starts the part's script.
import { api, button, command, complain, h, settle, wait, work } from "./lib.js";

const container = document.getElementById("part");

// The printed address ends with the token, which is exchanged for a cookie and removed from the address.
const enter = async () => {
  const token = location.hash.slice(1);
  if (!/^[\w-]{40,}$/.test(token)) return;
  history.replaceState(null, "", location.pathname + location.search);
  await api("/api/session", { method: "POST", body: { token } });
};

const showProject = (status) => {
  const name = document.getElementById("project");
  name.textContent = status.project;
  name.title = status.root;
  const working = document.getElementById("working");
  working.textContent = status.working.length
    ? status.working.map((job) => `${job.name}${job.share === null ? "" : ` ${Math.round(100 * job.share)} %`}`).join(", ")
    : "";
  settle("project", status.there ? null : `The project's folder is gone: ${status.root}. This page continues by itself when it is back.`);
};

// A folder without a project: a button for the first step, with its command.
const offer = () => {
  const jobs = h("div", { class: "jobs", "aria-live": "polite" });
  const fill = (minimal) => async () => {
    await work(jobs, await api("/api/project", { method: "POST", body: { minimal } }));
    location.reload();
  };
  container.before(h("section", { class: "panel beginning", "aria-label": "New project" },
    h("p", { class: "finding" }, "This folder holds no project yet."),
    h("p", {}, "Fill it with the shipped benches, their procedures, models and measured data, all of which run on a simulated bench; or make an empty project for your own."),
    h("div", { class: "toolbar" }, button("Fill it with examples", fill(false), { class: "primary", title: "rigctl init" }), button("Make an empty project", fill(true), { title: "rigctl init --minimal" }), jobs),
    command("rigctl init")));
};

const follow = async () => {
  for (;;) {
    await wait(document.hidden ? 8000 : 3000);
    try {
      showProject(await api("/api/status"));
      settle("server", null);
    } catch (problem) {
      settle("server", problem.status === 401 ? problem.message : "The server does not answer: it was ended, or is busy. This page continues by itself.");
    }
  }
};

const begin = async () => {
  try {
    await enter();
    const status = await api("/api/status");
    showProject(status);
    if (status.empty) offer();
  } catch (problem) {
    container.replaceChildren(
      h("p", { class: "statement warn" }, problem.status === 401 ? "This browser has not been let in yet." : problem.message),
      h("p", {}, "Open the address that ", h("code", {}, "rigctl serve"), " has printed, with what follows its #; it changes with every start."),
    );
    return;
  }
  follow();
  try {
    const part = await import(`./${document.body.dataset.part}.js`);
    await part.show(container);
    container.dataset.ready = "yes";
  } catch (problem) {
    complain(problem);
  }
};

begin();
