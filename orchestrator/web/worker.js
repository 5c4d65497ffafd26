"use strict";
// In a worker: flies as it is asked to, shows what there is of it now and then, and stops where it is
// asked for something newer.
const PARTS = 600; // of a line
const ROWS_OF_VIEW = 1500;
const SHARE = 4; // of the time that a look takes, so long until the next one

let newest = 0;
let free = null; // of the last flight, for models of others
let flight = null;

function shown(id, began, last) {
  const { rows } = flight;
  const message = {
    id, done: flight.made, fault: flight.fault, warnings: flight.warnings, last, seconds: (performance.now() - began) / 1e3,
    times: thinnedTimes(flight.told, rows, PARTS),
    plots: flight.charts().map(({ lines, limits }) => ({ lines: thinned(lines, rows, PARTS), limits })),
    handles: flight.handles,
  };
  message.end = flight.told.start + (rows - 1) * flight.told.step;
  message.ended = flight.ended;
  if (last) message.view = flight.view(ROWS_OF_VIEW);
  if (last && !flight.fault) {
    message.numbers = flight.numbers();
    message.unmet = flight.unmet();
    message.warnings = [...message.warnings, ...flight.remarks(), ...message.unmet.map((line) => `not met: ${line}`)];
  }
  postMessage(message);
}

// The answer of the model, at once, where there is one.
function model({ id, law, moved }) {
  if (!free || free.law !== flight.told.laws[law]) return;
  try {
    const found = modelled(flight.told, free.law, moved, free);
    if (!found) return;
    const [line] = thinned([found.line], found.line.length, PARTS);
    postMessage({ id, model: { line, times: found.times } });
  } catch { // the flight says why
  }
}

async function fly({ id, law, moved }) {
  const began = performance.now();
  if (flight.begin(law, moved)) {
    const { fault, warnings } = flight;
    return postMessage({ id, done: 0, fault, warnings, last: true, plots: [], times: [] });
  }
  let look = began + 100; // ms
  for (;;) {
    const more = flight.some();
    if (!more) {
      shown(id, began, true);
      free = flight.free() ?? free;
      return;
    }
    const now = performance.now();
    if (now > look) {
      shown(id, began, false);
      look = performance.now() + 100 + SHARE * (performance.now() - now);
    }
    if (flight.made % (8 * ROWS) === 0) {
      await new Promise((next) => { waiting.port2.postMessage(0); waiting.port1.onmessage = next; });
      if (id !== newest) return;
    }
  }
}
const waiting = new MessageChannel(); // a turn for what has come meanwhile

globalThis.onmessage = async ({ data }) => {
  if (data.told) {
    const module = await WebAssembly.compile(data.wasm);
    flight = new Flight(data.told, module);
    postMessage({ ready: true });
    return;
  }
  if (data.samples) { // of the flight that was asked for last, up to now
    postMessage({ samples: { times: flight.times(flight.made + 1).data, plots: flight.charts() } });
    return;
  }
  newest = data.id;
  model(data);
  fly(data);
};
