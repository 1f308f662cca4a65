// Formatting and parsing of values.
export const plain = (name) => name.replaceAll("_", " ");

// The significant digits of a slider's position: 3.912, 7.0e-15
export const figure = (value, digits = 4) => {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-3) return value.toExponential(Math.max(digits - 1, 1)).replace("e+", "e");
  return Number(value.toPrecision(digits)).toString();
};

export const shown = (slider, si) => (si - slider.offset) / slider.factor;
export const unitText = (unit) => (unit === "1" ? "" : unit.replaceAll("*", "·").replace(/\^(-?\d)/g, (_, power) => [...power].map((one) => ({ "-": "⁻", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵" })[one] ?? one).join("")));
export const withUnit = (slider, si) => `${figure(shown(slider, si))} ${unitText(slider.unit)}`.trim();

// A value with the significant digits from its uncertainty: 6.84e-15 ± 0.06e-15
export const spread = (value, std) => {
  if (!std || !Number.isFinite(std)) return figure(value);
  const digits = Math.min(Math.max(Math.floor(Math.log10(Math.abs(value) || std)) - Math.floor(Math.log10(std)) + 2, 1), 8);
  const shown = figure(value, digits);
  const [head, power] = shown.split("e");
  if (power !== undefined) return `(${head} ± ${(std / 10 ** Number(power)).toFixed(Math.max(digits - 1, 0))})e${power}`;
  return `${shown} ± ${figure(std, 2)}`;
};

export const chance = (p) => (p === null || p === undefined ? "–" : p < 1e-6 ? "< 1e-6" : figure(p, 2));
export const percent = (share) => (share < 0.0005 ? "< 0.1 %" : `${(100 * share).toFixed(share > 0.1 ? 0 : 1)} %`);

// a duration in s as text
export const duration = (seconds) => {
  const total = Math.round(seconds);
  if (total < 60) return `${total} s`;
  if (total < 3600) return `${Math.floor(total / 60)} min${total % 60 ? ` ${total % 60} s` : ""}`;
  return `${Math.floor(total / 3600)} h ${Math.round((total % 3600) / 60)} min`;
};
