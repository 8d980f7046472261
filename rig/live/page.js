// What the pages of a run and of a bench at rest share: they listen to the server, and say when it is silent.
"use strict";
const $ = (what, where = document) => where.querySelector(what);
const make = (tag, kind = "", text = "") => Object.assign(document.createElement(tag), { className: kind, textContent: text });
const STEPS = 1000, WARM = 0.8, FULL = 0.99, LOST_MS = 3000, HELD_MS = 20000;  // steps of a plot; shares of a range
const looks = [];  // of each picture: when it was there, ms since the page was asked for, and what `look` adds
let state = null, number = "0", answered = 0, heard = 0;

function word() {
  const silent = performance.now() - heard, gone = state && !state.ended && silent > LOST_MS;
  $("#lost").textContent = answered && performance.now() - answered > HELD_MS + LOST_MS ? "the page's server does not answer: rattle live" :
    gone ? `no word for ${Math.round(silent / 1000)} s` : "";
}

function news(events) {
  const list = $("ol");
  list.replaceChildren(...events.map(([level, ...said]) => make("li", level, said.join(" "))).reverse());
  while (list.scrollHeight > list.clientHeight && list.lastChild) list.lastChild.remove();
}

async function listen(draw, look) {
  addEventListener("resize", draw);
  for (;;) {
    try {
      const answer = await fetch(`state?after=${number}`);
      answered = performance.now();
      if (answer.status === 200) {
        number = answer.headers.get("X-Number");
        state = await answer.json();
        heard = performance.now();
        draw();
        await new Promise(requestAnimationFrame);
        await new Promise(done => setTimeout(done));  // now it has been painted
        if (state) looks.push([performance.now(), ...look()]);
        if (looks.length > 5000) looks.shift();
      }
    } catch (error) {
      console.error(error);
      await new Promise(done => setTimeout(done, 1000));
    }
  }
}
