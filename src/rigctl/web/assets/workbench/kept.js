// What this window keeps over a reload, under a name.
export const keeper = (name) => ({
  remembered: () => {
    try {
      return JSON.parse(sessionStorage.getItem(name) ?? "null");
    } catch {
      return null;
    }
  },
  remember: (what) => {
    try {
      sessionStorage.setItem(name, JSON.stringify(what));
    } catch {
      // without session storage it is lost at a reload
    }
  },
});
