// Of several columns the one that is chosen.
"use strict";
for (const choice of document.querySelectorAll(".choice")) {
  const select = choice.querySelector(":scope > .choosing select");
  const choose = () => [...choice.querySelectorAll(":scope > .chosen")].forEach((column, k) => {
    column.hidden = k !== Number(select.value);
  });
  select.addEventListener("input", choose);
  choose();  // a browser may keep what was chosen before the page was loaded anew
}
