// Fills the menu of versions from list.js, which lies beside the folders of all versions, so that a
// page of an old release also leads to later ones. Works without a server.
document.addEventListener("DOMContentLoaded", () => {
  const menu = document.querySelector("#versions");
  const root = document.documentElement.dataset.content_root || "./";
  const script = document.createElement("script");
  script.src = root + "../list.js";
  script.onload = () => {
    for (const name of window.SITE_VERSIONS) {
      const option = new Option(name, name, false, name === menu.dataset.version);
      menu.add(option);
    }
    menu.parentElement.hidden = false;
  };
  menu.addEventListener("change", () => {
    window.location.href = root + "../" + menu.value + "/index.html";
  });
  document.head.append(script);
});
