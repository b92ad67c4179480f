// Colours that canvas and WebGL need; everything else has its colour from style.css. Chosen to be told apart with the
// common kinds of colour blindness (after Okabe and Ito), and with 3:1 contrast or more to the ground of their theme.

const VEHICLES = {
  dark: ['#56b4e9', '#e69f00', '#2bc4a0', '#f0e442', '#ff8a65', '#e79cc8', '#9aa8ff', '#c9a27a', '#b5e48c', '#e6e9ec'],
  light: ['#0072b2', '#b45f00', '#00795a', '#7d6d00', '#c43c00', '#a8457f', '#4b3fb5', '#7a5230', '#4a7300', '#333a40'],
};

// Three components of a vector: x y z, or roll pitch yaw. Each has its own dash too.
const COMPONENTS = {
  dark: ['#ff8a65', '#2bc4a0', '#6cb6ff'],
  light: ['#c43c00', '#00795a', '#0067b8'],
};

export const DASHES = [[], [6, 3], [2, 2]];

// Ages of tracked points in frames, from new to old.
export const AGES = [
  { upTo: 0, colour: '#fde725', name: 'new' },
  { upTo: 5, colour: '#7ad151', name: '1–5' },
  { upTo: 20, colour: '#22c8a0', name: '6–20' },
  { upTo: 60, colour: '#4f9dde', name: '21–60' },
  { upTo: Infinity, colour: '#b58cff', name: '> 60 frames' },
];

const SCENES = {
  dark: { ground: '#0e1317', minor: '#232e36', major: '#3d4d58', axis: '#6b7c87', point: '#8b98a3', line: '#a9a18b', keyframe: '#5d6c78', loop: '#ff5d73', label: '#dfe6ea' },
  light: { ground: '#f8f9f7', minor: '#dde2df', major: '#b9c2be', axis: '#8b9693', point: '#6b7780', line: '#8a7f63', keyframe: '#97a3a8', loop: '#c2143c', label: '#1c2428' },
};

export function vehicleColour(theme, index) {
  const colours = VEHICLES[theme];
  return colours[index % colours.length];
}

export function componentColour(theme, index) {
  return COMPONENTS[theme][index % 3];
}

export function sceneColours(theme) {
  return SCENES[theme];
}

export function ageColour(age) {
  return AGES.find((step) => age <= step.upTo).colour;
}
