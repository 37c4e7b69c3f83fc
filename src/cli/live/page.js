"use strict";
// Draws what /events tells. Text goes in as text, never as markup.
const colours = { ".": "#cfe8cf", f: "#f2b84b", x: "#888888", " ": "#ffffff", on: "#b00020" };
const cell = 10, label = 40;
const at = (id) => document.getElementById(id);
let before = null;

function row(texts) {
  const tr = document.createElement("tr");
  for (const text of texts) tr.insertCell().textContent = text;
  return tr;
}

function head(of, open) {
  const box = document.createElement("div"), map = document.createElement("canvas");
  const title = document.createElement("p");
  title.textContent = `${of.printhead}: ${open.size} of ${of.channels.trim().length} channels with a fault`;
  const across = innerWidth < 640 ? 32 : 64, columns = Math.min(across, of.channels.length);
  map.width = label + columns * cell;
  map.height = Math.ceil(of.channels.length / across) * cell;
  const draw = map.getContext("2d");
  draw.font = "9px sans-serif";
  draw.textAlign = "right";
  draw.fillStyle = "#888";
  for (let first = 0; first < of.channels.length; first += across)
    draw.fillText(first, label - 4, (first / across) * cell + cell - 1);
  for (let channel = 0; channel < of.channels.length; channel++) {
    draw.fillStyle = colours[open.has(channel) ? "on" : of.channels[channel]];
    draw.fillRect(label + (channel % across) * cell, Math.floor(channel / across) * cell, cell - 1, cell - 1);
  }
  map.setAttribute("role", "img");
  map.setAttribute("aria-label", title.textContent);
  box.append(title, map);
  return box;
}

const second = (time) => time.slice(0, 19).replace("T", " ");

function sizeNow(f) {
  if (f.size_now) return `${f.size_now} (${second(f.as_of)})`;
  return f.as_of ? `not known since ${second(f.as_of)}` : "";
}

function show(state) {
  const now = performance.now();
  const again = before === null || state.signals < before.signals;
  const rate = again ? 0 : (state.signals - before.signals) / ((now - before.now) / 1000);
  before = { now, signals: state.signals };
  const rejected = Object.values(state.rejected).reduce((sum, n) => sum + n, 0);
  const behind = state.behind_bytes < 1e6 ? "keeps up" : `${(state.behind_bytes / 1e6).toFixed(1)} MB behind`;
  const newest = state.newest_at === null ? "nothing judged yet" : `newest burst ${second(state.newest_at)} UTC`;
  at("recording").textContent = state.recording;
  at("status").className = "";
  at("status").textContent = `${state.signals} signals, ${Math.round(rate)} a second, ${rejected} not judged; ${behind}; ` +
    newest + (state.ended ? "; the recording is closed" : "");
  at("count").textContent = state.faults.length;
  at("faults").replaceChildren(...state.faults.map((f) => row([f.printhead, f.channel, second(f.began_at), f.explanation, sizeNow(f)])));
  const open = new Map(state.heads.map((of) => [of.printhead, new Set()]));
  for (const f of state.faults) open.get(f.printhead)?.add(f.channel);
  at("heads").replaceChildren(...state.heads.map((of) => head(of, open.get(of.printhead))));
  return state.ended;
}

// A token of the page's address goes with it. Lost connections are taken up again by the browser; where it was refused
// (no room, no such program any more behind the port) it gives up, and we ask anew.
function listen() {
  const events = new EventSource("events" + location.search);
  events.onmessage = (message) => { if (show(JSON.parse(message.data))) events.close(); };
  events.onerror = () => {
    at("status").className = "lost";
    at("status").textContent = "not connected: what is shown is old; trying again …";
    if (events.readyState === EventSource.CLOSED) setTimeout(listen, 2000);
  };
}
listen();
