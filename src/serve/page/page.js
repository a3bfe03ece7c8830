// The page of `smalto serve`: shows the pictures of a viewer on the server, and sends it what the user does.
'use strict';

const at = (id) => document.getElementById(id);
const canvas = at('picture');
const context = canvas.getContext('2d', { alpha: false });

let socket = null;
let welcome = null;
let state = null;
let attempts = 0;
let names = [];
// The view and the settings at the last rest, which a link and a new connection have, too.
let saved = { view: null, preset: null, knobs: {}, look: null };
let exact = null;
let drawn = 0;
let parts = null;
const losses = new Map();
let received = [];
let roundTrip = null;
const held = new Set();
const pending = [];
let sending = false;

// What this tab keeps. Other pages behind a proxy have the same origin, so the path of the page is part of each name.
const kept = {
  name: (name) => `${location.pathname} ${name}`,
  get: (name) => sessionStorage.getItem(kept.name(name)),
  set: (name, text) => sessionStorage.setItem(kept.name(name), text),
  remove: (name) => sessionStorage.removeItem(kept.name(name)),
};

// ---- The address: the token and, after a while at rest, the view.

const token = (() => {
  const fragment = new URLSearchParams(location.hash.slice(1));
  const given = fragment.get('token');
  if (given) {
    kept.set('token', given);
    fragment.delete('token');
    history.replaceState(null, '', `${location.pathname}#${fragment}`);
  }
  return given || kept.get('token');
})();

function readAddress() {
  const text = new URLSearchParams(location.hash.slice(1)).get('view');
  try {
    if (text) saved = { ...saved, ...JSON.parse(text) };
  } catch (_) { /* An address that was cut begins at the first view. */ }
}

function address() {
  return '#' + new URLSearchParams({ view: JSON.stringify(saved) });
}

// Knobs of levels are no part of a preset.
function settings() {
  const knobs = {};
  welcome.knobs.forEach(({ name, is_of_levels: isOfLevels }, i) => {
    if (isOfLevels ? state.has_levels : !state.preset) knobs[name] = state.knobs[i];
  });
  return { view: state.rest.view, preset: state.preset, knobs, look: state.look };
}

// A pasted link or a new token.
window.addEventListener('hashchange', () => location.reload());

// ---- The connection.

function say(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function size() {
  const scale = window.devicePixelRatio || 1;
  const box = canvas.getBoundingClientRect();
  return [Math.max(1, Math.round(box.width * scale)), Math.max(1, Math.round(box.height * scale))];
}

function connect() {
  // Below the path of the page, which a proxy may have moved.
  const url = new URL('socket', location.href);
  url.protocol = url.protocol.replace('http', 'ws');
  socket = new WebSocket(url);
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => {
    drawn = 0;
    parts = exact = null;
    asked.length = 0;
    losses.clear();
    say({ do: 'hello', token, size: size(), view: saved.view });
  };
  const own = socket;
  socket.onmessage = ({ data }) => {
    if (typeof data === 'string') return hear(JSON.parse(data));
    received.push([performance.now(), data.byteLength]);
    showPicture(data, own);
  };
  socket.onclose = ({ reason }) => {
    socket = null;
    const wait = Math.min(4000, 250 * 2 ** attempts++);
    notice(`${reason || 'The server does not answer'}; trying again`);
    showWhat();
    setTimeout(connect, wait);
  };
}

function hear(message) {
  switch (message.say) {
    case 'welcome':
      welcome = message;
      attempts = 0;
      notice('');
      names = [];
      build();
      showCameras();
      if (saved.preset) say({ do: 'preset', name: saved.preset });
      for (const [knob, value] of Object.entries(saved.knobs)) say({ do: 'set', knob, value });
      if (saved.look) say({ do: 'look', name: saved.look, range: null });
      isRestored = null;
      break;
    case 'rests':
      isRestored = true;
      break;
    case 'state':
      state = message;
      if (isRestored === null && state.rest) restore();
      showState();
      break;
    case 'cameras':
      names = message.names;
      showCameras();
      break;
    case 'path':
      path = message.keys;
      keep('path', path);
      showPath();
      if (state) showTime();
      break;
    case 'film':
      at('video').src = at('film-file').href = message.file;
      at('film-ready').hidden = false;
      break;
    case 'loss':
      losses.set(message.picture, message.psnr);
      losses.delete(message.picture - 60);
      showWhat();
      break;
    case 'files':
      showFiles(message);
      break;
    case 'refused':
      notice(message.why);
      setTimeout(() => notice(''), 5000);
      // A value that was refused does not stay in its field.
      if (document.activeElement.matches('[data-knob], [data-placed]')) document.activeElement.blur();
      at('path-keys').dataset.content = '';
      showPath();
      if (state) showState();
      break;
    case 'pong':
      roundTrip = performance.now() - message.time;
      break;
  }
}

function notice(text) {
  at('notice').textContent = text;
  at('notice').hidden = !text;
}

// ---- Pictures.

async function showPicture(data, own) {
  const words = new DataView(data);
  const word = (i) => words.getUint32(4 * i, true);
  const [kind, number, answered, width, height] = [0, 1, 2, 3, 4].map(word);
  const images = [];
  let png = null;
  if (kind === 1) {
    const [reduction, count] = [word(5), word(6)];
    let place = 28 + 12 * count;
    for (let i = 0; i < count; i++) {
      const [top, , bytes] = [7 + 3 * i, 8 + 3 * i, 9 + 3 * i].map(word);
      const file = new Blob([new Uint8Array(data, place, bytes)], { type: 'image/jpeg' });
      images.push(createImageBitmap(file).then((image) => [image, top, reduction]));
      place += bytes;
    }
  } else {
    const [begin, bytes] = [word(5), word(6)];
    if (begin === 0) parts = { number, have: 0, all: [] };
    if (!parts || parts.number !== number) return;
    parts.all.push(new Uint8Array(data, 28));
    parts.have += data.byteLength - 28;
    if (parts.have < bytes) return;
    const file = new Blob(parts.all, { type: 'image/png' });
    parts = null;
    png = { number, file, isOfRender: kind === 3 };
    const options = { colorSpaceConversion: 'none', premultiplyAlpha: 'none' };
    images.push(createImageBitmap(file, options).then((image) => [image, 0, 1]));
  }
  let decoded = [];
  try {
    decoded = await Promise.all(images);
  } catch (_) {
    notice('The browser cannot decode a picture');
  }
  // Another connection begins to number anew. Strips of a picture may be decoded later than those of a newer one.
  if (own !== socket) return;
  if (number > drawn && decoded.length) {
    drawn = number;
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    context.imageSmoothingEnabled = false;
    for (const [image, top, scale] of decoded) {
      context.drawImage(image, 0, top, image.width * scale, image.height * scale);
    }
    exact = png;
    shownTimes.push(performance.now());
    answer(answered);
    showWhat();
  }
  decoded.forEach(([image]) => image.close());
  say({ do: 'shown', picture: number });
}

const shownTimes = [];

// The time from what the user does to the picture that answers it.
const asked = [];
let inputs = 0;
let latency = null;
function answer(number) {
  const count = asked.filter(([asking]) => asking <= number).length;
  const [first] = asked.splice(0, count);
  if (first) latency = performance.now() - first[1];
}

function showWhat() {
  let [text, detail] = ['connecting', ''];
  if (!socket) text = 'not connected';
  else if (exact) text = exact.isOfRender ? 'exact: the pixels of smalto render' : 'without loss';
  else if (drawn) {
    text = 'compressed';
    const psnr = losses.get(drawn);
    if (psnr !== undefined) detail = psnr === null ? ', no pixel differs' : `, ${psnr.toFixed(1)} dB`;
  } else if (state && !state.rest) text = 'reading the scene';
  // A screen reader says the kind of picture, and not each loss.
  for (const [id, value] of [['what', text], ['loss', detail]]) {
    if (at(id).textContent !== value) at(id).textContent = value;
  }
  at('what').classList.toggle('is-exact', !!exact && exact.isOfRender);
  at('save').disabled = !exact;
  document.body.dataset.picture = exact ? 'exact' : drawn ? 'compressed' : 'none';
}

setInterval(() => {
  const now = performance.now();
  received = received.filter(([time]) => now - time < 1000);
  while (shownTimes.length && now - shownTimes[0] > 1000) shownTimes.shift();
  const bits = 8e-6 * received.reduce((sum, [, bytes]) => sum + bytes, 0);
  const list = [];
  if (shownTimes.length > 1) list.push(`${shownTimes.length} pictures/s`);
  if (bits > 0.05) list.push(`${bits.toFixed(1)} Mbit/s`);
  if (latency !== null && shownTimes.length > 1) list.push(`input to picture ${latency.toFixed(0)} ms`);
  if (roundTrip !== null) list.push(`round trip ${roundTrip.toFixed(0)} ms`);
  at('pace').textContent = list.join(', ');
}, 500);
setInterval(() => say({ do: 'ping', time: performance.now() }), 2000);

// ---- The panel.

function option(value, text) {
  const made = document.createElement('option');
  made.value = value;
  made.textContent = text === undefined ? value : text;
  return made;
}

function build() {
  at('preset').replaceChildren(option('', 'own settings'), ...welcome.presets.map((name) => option(name)));
  const photographs = option('photographs', 'photographs of the cameras');
  photographs.id = 'photographs';
  at('with').replaceChildren(option('nothing'), ...welcome.presets.map((name) => option(name)),
    option('reference', 'float64 reference'), photographs);
  at('no-films').hidden = welcome.has_films;
  at('look').replaceChildren(...welcome.looks.map(({ name, title }) => option(name, title)));
  const stops = welcome.colours.map((colour, i) => `${colour} ${(100 * i) / (welcome.colours.length - 1)}%`);
  at('colours').style.background = `linear-gradient(to right, ${stops.join(', ')})`;
  at('files').hidden = !welcome.has_folder;
  at('knobs').replaceChildren(...welcome.knobs.map(knobRow));
  const pointer = [
    ['left drag', 'turn around the point in the middle'],
    ['right drag', 'look around'],
    ['middle drag, Shift + left drag', 'move sideways'],
    ['wheel, two fingers', 'nearer or farther'],
    ['double click', 'turn around this point'],
    ['X', 'explain the pixel under the pointer'],
    ['M', 'add the point under the pointer to a measure'],
    ['H', 'hide or show the panel'],
    ['Escape', 'close messages and the explanation'],
  ];
  const rows = [...pointer, ...welcome.actions.map(({ key, help }) => [key, help])];
  at('keys').tBodies[0].replaceChildren(...rows.map(([key, help]) => row([key, 'th'], [help, 'td'])));
}

function row(...cells) {
  const made = document.createElement('tr');
  for (const [text, kind, className] of cells) {
    const cell = made.appendChild(document.createElement(kind));
    if (kind === 'th') cell.scope = 'row';
    if (className) cell.className = className;
    if (text instanceof Node) cell.append(text);
    else cell.textContent = text;
  }
  return made;
}

function knobRow({ name, help, kind }) {
  const made = document.createElement('label');
  made.className = 'knob';
  made.title = help;
  const text = made.appendChild(document.createElement('span'));
  text.textContent = name;
  let input;
  if (kind.type === 'name') {
    input = document.createElement('select');
    input.replaceChildren(...kind.names.map((value) => option(value)));
  } else {
    input = document.createElement('input');
    input.type = kind.type === 'flag' ? 'checkbox' : 'text';
  }
  input.dataset.knob = name;
  input.addEventListener('change', () => {
    const value = input.type === 'checkbox' ? String(input.checked) : input.value;
    say({ do: 'set', knob: name, value });
  });
  made.append(input);
  return made;
}

function put(input, value) {
  if (document.activeElement !== input || input.tagName === 'SELECT') {
    if (input.type === 'checkbox') input.checked = value === 'true';
    else if (input.value !== value) input.value = value;
  }
}

function showCameras() {
  at('cameras').hidden = !names.length;
  const chosen = state && state.camera !== null ? String(state.camera) : '';
  at('camera').replaceChildren(option('', `none of ${names.length}`), ...names.map((name, i) => option(i, `${i}: ${name}`)));
  at('camera').value = chosen;
}

function showState() {
  document.title = state.title;
  at('title').textContent = state.title;
  at('camera').value = state.camera === null ? '' : String(state.camera);
  put(at('preset'), state.preset || '');
  welcome.knobs.forEach(({ is_of_levels: isOfLevels }, i) => {
    const made = at('knobs').children[i];
    made.hidden = isOfLevels && !state.has_levels;
    put(made.querySelector('[data-knob]'), state.knobs[i]);
  });
  const isChoosing = state.choosing !== null;
  at('choosing').hidden = at('stop-budget').hidden = !isChoosing;
  if (isChoosing) at('choosing').value = state.choosing;
  at('choose').disabled = isChoosing;
  at('chosen').textContent = state.chosen || '';
  put(at('look'), state.look);
  const look = welcome.looks.find(({ name }) => name === state.look);
  at('scale').hidden = !look.has_scale;
  at('unit').textContent = look.unit;
  put(at('low'), String(state.range[0]));
  put(at('high'), String(state.range[1]));
  showScenes();
  showStages();
  at('photographs').hidden = !state.has_photographs;
  showComparison();
  showExplanation();
  showMeasures();
  showTime();
  const messages = [...state.messages];
  if (state.nothing) messages.push({ is_error: false, text: state.nothing });
  if (isNew(at('messages'), messages)) {
    at('messages').replaceChildren(...messages.map(({ is_error: isError, text }) => {
      const made = document.createElement('p');
      made.textContent = text;
      if (isError) made.className = 'error';
      return made;
    }));
  }
  at('link').disabled = at('command').disabled = !state.rest;
  if (state.rest) {
    saved = settings();
    history.replaceState(null, '', address());
  }
  showWhat();
}

// True if an element shows something else. What is made again loses the keyboard, and is read out again.
function isNew(element, content) {
  const text = JSON.stringify(content);
  const isOther = element.dataset.content !== text;
  element.dataset.content = text;
  return isOther;
}

function showScenes() {
  if (isNew(at('scenes'), state.scenes.map(({ name }) => name))) {
    at('scenes').replaceChildren(...state.scenes.map(({ name }, i) => sceneRow(name, i)));
  }
  state.scenes.forEach(({ name, summary, is_shown: isShown, placement, progress }, i) => {
    const made = at('scenes').children[i];
    made.title = summary;
    made.querySelector('[type=checkbox]').checked = isShown;
    made.querySelector('label span').textContent =
      progress === null ? name : `${name}, ${Math.round(100 * progress)} % read`;
    const values = placementValues(placement);
    made.querySelectorAll('[data-placed]').forEach((input, k) => put(input, String(values[k])));
  });
  const placed = state.scenes.filter(({ placement }) => placementValues(placement).some((value, k) => value !== UNMOVED[k]));
  keep('placements', placed.map(({ name, placement }) => [name, placement]));
}

function sceneRow(name, scene) {
  const made = document.createElement('div');
  const label = made.appendChild(document.createElement('label'));
  label.className = 'row';
  const box = label.appendChild(document.createElement('input'));
  box.type = 'checkbox';
  box.addEventListener('change', () => say({ do: 'show', scene, is_shown: box.checked }));
  label.appendChild(document.createElement('span'));
  if (state.scenes.length > 1) {
    const close = label.appendChild(document.createElement('button'));
    close.textContent = 'close';
    close.setAttribute('aria-label', `Close ${name}`);
    close.addEventListener('click', (event) => {
      event.preventDefault();
      say({ do: 'close', scene });
    });
  }
  made.append(placementOf(name, scene));
  return made;
}

const UNMOVED = [0, 0, 0, 0, 0, 0, 1];
const placementValues = ({ position, rotation, scale }) => [...position, ...rotation, scale];

// The fields of the placement of a scene.
function placementOf(name, scene) {
  const made = document.createElement('details');
  made.appendChild(document.createElement('summary')).textContent = 'Placement';
  const inputs = [];
  const changed = () => {
    const before = placementValues(state.scenes[scene].placement);
    const values = inputs.map(({ valueAsNumber: value }, k) => (Number.isNaN(value) ? before[k] : value));
    inputs.forEach((input, k) => { input.value = values[k]; });
    say({ do: 'place', scene, placement: { position: values.slice(0, 3), rotation: values.slice(3, 6), scale: values[6] } });
  };
  const axes = [' x', ' y', ' z'];
  for (const [title, unit, step, names] of [['Position', '', 0.01, axes], ['Rotation', ', °', 1, axes], ['Scale', '', 0.01, ['']]]) {
    const line = made.appendChild(document.createElement('div'));
    line.className = 'row place';
    line.appendChild(document.createElement('span')).textContent = title + unit;
    if (unit) line.title = 'Around z first, then x, then y';
    for (const axis of names) {
      const input = line.appendChild(document.createElement('input'));
      input.type = 'number';
      input.step = step;
      input.dataset.placed = scene;
      input.setAttribute('aria-label', `${title}${axis} of ${name}`);
      input.addEventListener('change', changed);
      inputs.push(input);
    }
  }
  return made;
}

function showStages() {
  const rows = [];
  const ms = (value) => `${value.toFixed(3)} ms`;
  if (state.gpu_ms !== null) rows.push(row(['frame', 'th'], [ms(state.gpu_ms), 'td', 'number']));
  for (const [name, value] of state.stages) rows.push(row([name, 'th'], [ms(value), 'td', 'number']));
  if (state.clocks) {
    const clocks = row(['clocks', 'th'], [`${state.clocks.shader_mhz} MHz, memory ${state.clocks.memory_mhz} MHz`, 'td', 'number']);
    clocks.title = 'A GPU that has little to do lowers its clocks, and each frame then takes longer';
    rows.push(clocks);
  }
  if (state.path) rows.push(row(['path', 'th'], [state.path, 'td', 'number']));
  rows.push(row(['visible Gaussians', 'th'], [state.visible.toLocaleString('en'), 'td', 'number']));
  if (state.missing_pages) rows.push(row(['pages missing', 'th'], [String(state.missing_pages), 'td', 'number']));
  if (state.levels) rows.push(row(['levels, to all Gaussians', 'th'], [state.levels, 'td', 'number']));
  at('stages').tBodies[0].replaceChildren(...rows);
}

function showComparison() {
  const shown = state.comparison;
  at('split').hidden = !shown || shown.mode !== 'split';
  if (!shown) {
    at('compared').textContent = '';
    put(at('with'), 'nothing');
    return;
  }
  at('split').style.left = `${100 * shown.split}%`;
  for (const input of document.getElementsByName('by')) input.checked = input.value === shown.mode;
  let text = `${shown.first} and ${shown.second}`;
  if (shown.is_loading) text = 'the second picture is being drawn';
  else if (shown.mismatch) text += `: the second is of ${shown.mismatch}`;
  else if (shown.flip !== null) text += shown.psnr === null ? ': equal' : `: ${shown.psnr.toFixed(2)} dB, FLIP ${shown.flip.toFixed(4)}`;
  at('compared').textContent = text;
}

function showExplanation() {
  const explained = state.explanation;
  at('mark').hidden = !explained || !explained.is_of_view;
  if (!explained) {
    at('explained').replaceChildren();
    return;
  }
  const { pixel, colour, depth, splats, first, transmittance } = explained;
  const [width, height] = [canvas.width, canvas.height];
  at('mark').style.left = `${(100 * (pixel[0] + 0.5)) / width}%`;
  at('mark').style.top = `${(100 * (pixel[1] + 0.5)) / height}%`;
  const intro = document.createElement('p');
  const far = depth === null ? 'nothing is drawn here' : `depth ${depth.toFixed(3)}`;
  intro.textContent = `Pixel ${pixel.join(', ')}: colour ${colour.map((value) => value.toFixed(3)).join(' ')}, ${far}, ` +
    `${splats} splats, ${(100 * transmittance).toFixed(1)} % of the background`;
  const table = document.createElement('table');
  const head = table.createTHead();
  head.append(row(['Gaussian', 'th'], ['depth', 'th'], ['alpha', 'th'], ['share', 'th'], ['colour', 'th']));
  const body = table.createTBody();
  for (const splat of first) {
    const swatch = document.createElement('span');
    swatch.className = 'swatch';
    swatch.style.background = `rgb(${splat.colour.map((value) => Math.round(255 * Math.min(1, Math.max(0, value)))).join(',')})`;
    body.append(row([String(splat.gaussian), 'td'], [splat.depth.toFixed(3), 'td'], [splat.alpha.toFixed(4), 'td'],
      [splat.share.toFixed(4), 'td'], [swatch, 'td']));
  }
  at('explained').replaceChildren(intro, table);
  if (JSON.stringify(pixel) !== showExplanation.last) {
    at('explained-section').open = true;
    at('explained-section').scrollIntoView({ block: 'nearest' });
  }
  showExplanation.last = JSON.stringify(pixel);
}

// ---- Measures and the camera path. The server has them; the page keeps them for the next connection of this tab.

let path = [];
// Null before what was kept is sent to the server, false until it is there.
let isRestored = null;

function keep(name, value) {
  if (isRestored) kept.set(name, JSON.stringify(value));
}

// What was kept is of these scenes, and not of others that a server at the same address shows later.
function restore() {
  const read = (name) => JSON.parse(kept.get(name));
  const scenes = state.scenes.map(({ name }) => name);
  const isSame = JSON.stringify(read('scenes')) === JSON.stringify(scenes);
  const [measures, keys, placements] = isSame ? [read('measures'), read('path'), read('placements')] : [];
  isRestored = false;
  path = [];
  showPath();
  at('film-ready').hidden = true;
  if (measures) say({ do: 'measures', measures });
  if (keys) say({ do: 'path', keys });
  scenes.forEach((name, scene) => {
    const k = placements ? placements.findIndex(([of]) => of === name) : -1;
    if (k >= 0) say({ do: 'place', scene, placement: placements.splice(k, 1)[0][1] });
  });
  if (!isSame) ['measures', 'path', 'placements'].forEach((name) => kept.remove(name));
  kept.set('scenes', JSON.stringify(scenes));
  say({ do: 'rest', number: 0 });
}

const ownMeasures = () => {
  const measures = { all: state.measures.map(({ kind, points }) => ({ kind, points })) };
  return state.unit ? { ...measures, unit: state.unit } : measures;
};

function showMeasures() {
  const all = state.measures;
  showLines(all);
  put(at('kind'), state.measures_next);
  const open = all.find(({ is_open: isOpen }) => isOpen);
  at('known').hidden = !open || open.points.length < 2;
  at('no-unit').hidden = !state.unit;
  if (!isNew(at('measures'), all.map(({ pixels, lines, labels, ...rest }) => rest))) return;
  keep('measures', ownMeasures());
  at('measures').replaceChildren(...all.map(({ kind, points, reading, is_open: isOpen }, i) => {
    const made = document.createElement('div');
    made.className = 'row';
    const text = made.appendChild(document.createElement('span'));
    text.textContent = `${i + 1} ${kind}: ${reading || `${points.length} points`}`;
    text.title = points.map((point) => point.map((value) => value.toFixed(6)).join(', ')).join('\n');
    if (isOpen) text.style.fontWeight = 600;
    const remove = made.appendChild(document.createElement('button'));
    remove.textContent = 'remove';
    remove.setAttribute('aria-label', `Remove measure ${i + 1}`);
    remove.addEventListener('click', () => {
      const measures = ownMeasures();
      measures.all.splice(i, 1);
      say({ do: 'measures', measures });
    });
    return made;
  }));
  if (all.length > showMeasures.count) at('measures-section').open = true;
  showMeasures.count = all.length;
}
showMeasures.count = 0;

// Measures are drawn over pictures at rest.
function showLines(all) {
  const over = at('lines');
  over.setAttribute('viewBox', `0 0 ${canvas.width} ${canvas.height}`);
  over.setAttribute('preserveAspectRatio', 'none');
  const make = (name, values) => {
    const made = document.createElementNS('http://www.w3.org/2000/svg', name);
    for (const [key, value] of Object.entries(values)) made.setAttribute(key, value);
    return made;
  };
  const shown = [];
  for (const { pixels, lines, labels } of all) {
    for (const [from, to] of lines) shown.push(make('polyline', { points: `${from} ${to}` }));
    for (const pixel of pixels) if (pixel) shown.push(make('circle', { cx: pixel[0], cy: pixel[1], r: 3 }));
    for (const { pixel, text } of labels) {
      const label = make('text', { x: pixel[0], y: pixel[1], 'font-size': 12 * canvas.width / canvas.clientWidth });
      label.textContent = text;
      shown.push(label);
    }
  }
  over.replaceChildren(...shown);
}

at('kind').addEventListener('change', ({ target }) => say({ do: 'measure', kind: target.value }));
at('set-unit').addEventListener('click', () => {
  say({ do: 'unit', name: at('unit-name').value, length: Number(at('length').value) });
});
at('no-unit').addEventListener('click', () => say({ do: 'measures', measures: { all: ownMeasures().all } }));

const setPath = (keys) => say({ do: 'path', keys });

function showPath() {
  at('path-tools').hidden = !path.length;
  if (path.length > showPath.count) at('path-section').open = true;
  showPath.count = path.length;
  if (path.length) at('time').max = path[path.length - 1].seconds;
  if (!isNew(at('path-keys'), path)) return;
  at('path-keys').tBodies[0].replaceChildren(...path.map((key, i) => {
    const input = (type, label) => {
      const made = document.createElement('input');
      made.type = type;
      made.setAttribute('aria-label', `${label} of key ${i}`);
      return made;
    };
    const others = path.filter((_, j) => j !== i);
    const [seconds, rests] = [input('number', 'Time'), input('checkbox', 'Rest')];
    [seconds.value, seconds.min, seconds.step, rests.checked] = [key.seconds, 0, 'any', !!key.rests];
    // A time that another key has, or none, is refused, and the key stays.
    seconds.addEventListener('change', () => setPath([...others, { ...key, seconds: Number(seconds.value) }]));
    rests.addEventListener('change', () => setPath([...others, { ...key, rests: rests.checked }]));
    const button = (text, act) => {
      const made = document.createElement('button');
      made.textContent = text;
      made.setAttribute('aria-label', `${text} key ${i}`);
      made.addEventListener('click', act);
      return made;
    };
    return row([seconds, 'td'], [rests, 'td'], [button('show', () => say({ do: 'time', seconds: key.seconds })), 'td'],
      [button('remove', () => setPath(others)), 'td']);
  }));
}
showPath.count = 0;

function showTime() {
  put(at('time'), String(state.time));
  at('now').textContent = `${state.time.toFixed(1)} s`;
  at('play').textContent = state.is_playing ? 'Stop' : 'Play';
  const isWriting = state.writing !== null;
  at('writing').hidden = at('stop-film').hidden = !isWriting;
  if (isWriting) {
    at('writing').value = state.writing;
    // The server removes the film before.
    at('film-ready').hidden = true;
  }
  at('film').disabled = !welcome.has_films || isWriting || path.length < 2;
}

at('turn').addEventListener('click', () => say({ do: 'turn' }));
at('time').addEventListener('input', ({ target }) => say({ do: 'time', seconds: Number(target.value) }));
at('close-path').addEventListener('click', () => say({ do: 'close-path' }));
at('save-path').addEventListener('click', () => save(new Blob([JSON.stringify(path, null, 1)]), 'path.json'));
at('drop-path').addEventListener('click', () => setPath([]));
at('film').addEventListener('click', () => say({ do: 'film', fps: Number(at('fps').value) }));
at('stop-film').addEventListener('click', () => say({ do: 'stop-film' }));

function showFiles({ folder, folders, files }) {
  const button = (text, act) => {
    const made = document.createElement('button');
    made.textContent = text;
    made.addEventListener('click', act);
    return made;
  };
  const below = (name) => (folder ? `${folder}/${name}` : name);
  const list = [];
  if (folder) list.push(button('..', () => say({ do: 'files', folder: folder.split('/').slice(0, -1).join('/') })));
  for (const name of folders) list.push(button(`${name}/`, () => say({ do: 'files', folder: below(name) })));
  for (const name of files) {
    list.push(button(name, () => {
      say({ do: 'open', file: below(name) });
      at('listing').replaceChildren();
    }));
  }
  if (!list.length) list.push('Nothing here can be opened.');
  at('listing').replaceChildren(...list);
}

at('browse').addEventListener('click', () => say({ do: 'files', folder: '' }));
at('camera').addEventListener('change', ({ target }) => target.value !== '' && say({ do: 'camera', index: Number(target.value) }));
at('preset').addEventListener('change', ({ target }) => {
  if (!target.value) return;
  say({ do: 'preset', name: target.value });
});
at('budget-kind').addEventListener('change', ({ target }) => {
  at('budget').value = target.value === 'min-psnr' ? 60 : 0.02;
});
at('choose').addEventListener('click', () => {
  say({ do: 'budget', budget: { [at('budget-kind').value]: Number(at('budget').value) } });
});
at('stop-budget').addEventListener('click', () => say({ do: 'stop-budget' }));
at('look').addEventListener('change', ({ target }) => {
  say({ do: 'look', name: target.value, range: null });
});
for (const id of ['low', 'high']) {
  at(id).addEventListener('change', () => say({ do: 'look', name: state.look, range: [Number(at('low').value), Number(at('high').value)] }));
}
at('with').addEventListener('change', ({ target }) => say({ do: 'compare', with: target.value }));
function compareBy(split) {
  const mode = [...document.getElementsByName('by')].find((input) => input.checked).value;
  say({ do: 'compare-by', mode, split, gain: 10 ** Number(at('gain').value) });
}
for (const input of document.getElementsByName('by')) input.addEventListener('change', () => compareBy(null));
at('gain').addEventListener('input', () => compareBy(null));
for (const button of document.querySelectorAll('[data-act]')) {
  button.addEventListener('click', () => say({ do: 'act', action: button.dataset.act }));
}
at('save').addEventListener('click', () => exact && save(exact.file, 'view.png'));
function save(file, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(file);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
async function copy(text, what) {
  try {
    await navigator.clipboard.writeText(text);
    notice(`${what} is copied`);
    setTimeout(() => notice(''), 2000);
  } catch (_) {
    // Pages that are not from this machine may not write to the clipboard.
    prompt('Copy this:', text);
  }
}
at('link').addEventListener('click', () => copy(location.origin + location.pathname + address(), 'The link'));
at('command').addEventListener('click', () => {
  const { command, left_out: leftOut } = state.rest;
  copy(command, leftOut.length ? `The command without ${leftOut.join(' and ')}` : 'The command');
});
at('open-panel').addEventListener('click', togglePanel);
function togglePanel() {
  const isHidden = document.body.classList.toggle('is-hidden');
  at('open-panel').setAttribute('aria-expanded', String(!isHidden));
}

// ---- Pointer and keys: all events since the last frame of the page are one message.

function input(event) {
  const last = pending[pending.length - 1];
  if (event.kind === 'move' && last && last.kind === 'move') pending.pop();
  pending.push(event);
  if (!sending) {
    sending = true;
    requestAnimationFrame(flush);
  }
}

function flush() {
  sending = false;
  if (pending.length) {
    inputs += 1;
    if (asked.length < 1000) asked.push([inputs, performance.now()]);
    say({ do: 'input', number: inputs, events: pending.splice(0, 200) });
  }
  if (pending.length) input(pending.pop());
}

const keysHeld = (event) => ({ shift: event.shiftKey, ctrl: event.ctrlKey || event.metaKey, alt: event.altKey });
let pointer = [0, 0];
function place(event) {
  const box = canvas.getBoundingClientRect();
  pointer = [((event.clientX - box.left) * canvas.width) / box.width, ((event.clientY - box.top) * canvas.height) / box.height];
  return { x: pointer[0], y: pointer[1] };
}
const pixel = () => pointer.map((side) => Math.max(0, Math.floor(side)));

const BUTTONS = ['left', 'middle', 'right'];
const touches = new Map();
let pressed = null;

canvas.addEventListener('pointerdown', (event) => {
  canvas.focus();
  canvas.setPointerCapture(event.pointerId);
  const { x, y } = place(event);
  if (event.pointerType === 'touch') {
    touches.set(event.pointerId, [event.clientX, event.clientY]);
    if (touches.size === 2) {
      // Two fingers move and zoom: the first one had begun to turn.
      if (pressed) input({ kind: 'button', x, y, button: pressed, is_pressed: false, held: keysHeld(event) });
      pressed = 'middle';
    } else if (touches.size === 1) pressed = 'left';
    else return;
    input({ kind: 'move', x, y });
    input({ kind: 'button', x, y, button: pressed, is_pressed: true, held: keysHeld(event) });
    return;
  }
  const shown = state && state.comparison;
  if (event.button === 0 && shown && shown.mode === 'split' && Math.abs(x / canvas.width - shown.split) * canvas.clientWidth < 6) {
    canvas.dataset.drags = 'split';
    return;
  }
  input({ kind: 'move', x, y });
  if (BUTTONS[event.button]) input({ kind: 'button', x, y, button: BUTTONS[event.button], is_pressed: true, held: keysHeld(event) });
});
canvas.addEventListener('pointermove', (event) => {
  if (event.pointerType === 'touch' && touches.size === 2 && touches.has(event.pointerId)) {
    const distance = () => {
      const [a, b] = [...touches.values()];
      return Math.hypot(a[0] - b[0], a[1] - b[1]);
    };
    const before = distance();
    touches.set(event.pointerId, [event.clientX, event.clientY]);
    if (before > 0) input({ kind: 'zoom', factor: distance() / before });
    if (event.pointerId !== [...touches.keys()][0]) return;
  }
  if (canvas.dataset.drags === 'split') {
    place(event);
    compareBy(pointer[0] / canvas.width);
    return;
  }
  // A pointer that only lies over the picture changes nothing on the server.
  const moved = place(event);
  if (event.buttons) input({ kind: 'move', ...moved });
});
function release(event) {
  if (canvas.dataset.drags === 'split') {
    delete canvas.dataset.drags;
    return;
  }
  const { x, y } = place(event);
  let button = BUTTONS[event.button];
  if (event.pointerType === 'touch') {
    touches.delete(event.pointerId);
    button = pressed;
    pressed = null;
  }
  if (button) input({ kind: 'button', x, y, button, is_pressed: false, held: keysHeld(event) });
}
canvas.addEventListener('pointerup', release);
canvas.addEventListener('pointercancel', release);
canvas.addEventListener('pointerleave', () => input({ kind: 'gone' }));
canvas.addEventListener('contextmenu', (event) => event.preventDefault());
canvas.addEventListener('auxclick', (event) => event.preventDefault());
canvas.addEventListener('wheel', (event) => {
  event.preventDefault();
  const points = event.deltaMode === 1 ? 20 * event.deltaY : event.deltaY;
  input({ kind: 'move', ...place(event) });
  input({ kind: 'wheel', points: -points });
}, { passive: false });

// The name of a key as the server writes it: Ctrl+Z, N, Delete.
function keyName(event) {
  const key = event.key.length === 1 ? event.key.toUpperCase() : event.key;
  const list = [];
  if (event.ctrlKey || event.metaKey) list.push('Ctrl');
  if (event.shiftKey) list.push('Shift');
  if (event.altKey) list.push('Alt');
  return [...list, key === ' ' ? 'Space' : key].join('+');
}
const plainName = (event) => (event.key === ' ' ? 'Space' : event.key.length === 1 ? event.key.toUpperCase() : event.key);

document.addEventListener('keydown', (event) => {
  const target = event.target;
  if (target.matches('select, input:not([type=checkbox], [type=radio], [type=range])') || !welcome) return;
  const isWidget = target.matches('button, summary, input');
  if (isWidget && [' ', 'Enter', 'ArrowLeft', 'ArrowRight', 'ArrowUp', 'ArrowDown'].includes(event.key)) return;
  // With the command key of a Mac, no release of another key is told.
  const flies = !event.metaKey && welcome.actions.find(({ is_held: isHeld, key }) => isHeld && key === plainName(event));
  const acts = welcome.actions.find(({ is_held: isHeld, key }) => !isHeld && key === keyName(event));
  if (acts) say({ do: 'act', action: acts.name });
  else if (flies && !event.repeat) {
    held.add(flies.name);
    input({ kind: 'key', action: flies.name, is_pressed: true, held: keysHeld(event) });
  } else if (event.key === 'Escape') say({ do: 'act', action: 'escape' });
  else if (keyName(event) === 'X') say({ do: 'explain', pixel: pixel() });
  else if (keyName(event) === 'M') say({ do: 'mark', pixel: pixel() });
  else if (keyName(event) === 'H') togglePanel();
  else if ((event.key === 'Shift' || event.key === 'Control') && held.size) {
    for (const action of held) input({ kind: 'key', action, is_pressed: true, held: keysHeld(event) });
  } else if (!flies) return;
  event.preventDefault();
});
document.addEventListener('keyup', (event) => {
  if (!welcome) return;
  const flies = welcome.actions.find(({ is_held: isHeld, key }) => isHeld && key === plainName(event));
  if (flies && held.delete(flies.name)) input({ kind: 'key', action: flies.name, is_pressed: false, held: keysHeld(event) });
  else if (held.size) for (const action of held) input({ kind: 'key', action, is_pressed: true, held: keysHeld(event) });
});
window.addEventListener('blur', () => {
  for (const action of held) input({ kind: 'key', action, is_pressed: false });
  held.clear();
  input({ kind: 'blur' });
});

let resized = null;
new ResizeObserver(() => {
  clearTimeout(resized);
  resized = setTimeout(() => say({ do: 'resize', size: size() }), 60);
}).observe(canvas);

readAddress();
connect();
