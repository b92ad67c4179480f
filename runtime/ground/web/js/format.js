// Numbers for people. What is not known is an en dash; a minus is a hyphen, so that numbers can be copied.

export const UNKNOWN = '–';

export function number(value, digits = 2) {
  if (typeof value !== 'number' || !Number.isFinite(value)) return UNKNOWN;
  const text = value.toFixed(digits);
  return Number(text) === 0 && text.startsWith('-') ? text.slice(1) : text;
}

export function vector(values, digits = 2) {
  return Array.isArray(values) ? values.map((x) => number(x, digits)).join(' ') : UNKNOWN;
}

// A number with its sign: plus or minus.
export function signed(value, digits = 1) {
  const text = number(value, digits);
  return text === UNKNOWN || text.startsWith('-') ? text : `+${text}`;
}

// A direction as three digits, 000 to 359.
export function degrees3(value) {
  if (typeof value !== 'number' || !Number.isFinite(value)) return UNKNOWN;
  return String(((Math.round(value) % 360) + 360) % 360).padStart(3, '0');
}

// A count with thin spaces between thousands.
export function count(value) {
  return Number.isFinite(value) ? String(Math.round(value)).replace(/\B(?=(\d{3})+$)/g, '\u2009') : UNKNOWN;
}

// A small number with as many digits as tell something: three significant ones.
export function significant(value) {
  if (typeof value !== 'number' || !Number.isFinite(value)) return UNKNOWN;
  if (value === 0) return '0';
  const digits = Math.max(0, Math.min(6, 2 - Math.floor(Math.log10(Math.abs(value)))));
  return value.toFixed(digits);
}

export function ratio(pair, first, second) {
  return pair ? `${count(pair[first])} / ${count(pair[second])}` : UNKNOWN;
}

// A duration in one or two units.
export function duration(seconds) {
  if (!Number.isFinite(seconds)) return UNKNOWN;
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 60) return `${Math.floor(seconds)} s`;
  const minutes = Math.floor(seconds / 60);
  if (minutes < 60) return `${minutes} min ${String(Math.floor(seconds % 60)).padStart(2, '0')} s`;
  return `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, '0')} min`;
}

// Time of day, local.
export function clock(date) {
  return [date.getHours(), date.getMinutes(), date.getSeconds()].map((x) => String(x).padStart(2, '0')).join(':');
}

// Nanoseconds in a string as seconds with three decimals, exactly.
export function stampSeconds(stamp) {
  if (typeof stamp !== 'string' || !/^-?\d{1,20}$/.test(stamp)) return UNKNOWN;
  const digits = stamp.replace('-', '').padStart(10, '0');
  return `${stamp.startsWith('-') ? '-' : ''}${digits.slice(0, -9)}.${digits.slice(-9, -6)}`;
}

export function bits(value) {
  return Number.isInteger(value) && value >= 0 ? `0x${value.toString(16).padStart(4, '0')}` : UNKNOWN;
}
