// Values as people read and type them.
export const plain = (name) => name.replaceAll("_", " ");

// Digits that a slider's place deserves: 3.912, 7.0e-15
export const figure = (value, digits = 4) => {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-3) return value.toExponential(Math.max(digits - 2, 1)).replace("e+", "e");
  return Number(value.toPrecision(digits)).toString();
};

export const shown = (slider, si) => (si - slider.offset) / slider.factor;
export const unitText = (unit) => (unit === "1" ? "" : unit.replaceAll("*", "·").replace(/\^(-?\d)/g, (_, power) => [...power].map((one) => ({ "-": "⁻", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵" })[one] ?? one).join("")));
export const withUnit = (slider, si) => `${figure(shown(slider, si))} ${unitText(slider.unit)}`.trim();

// A value to the digits that its uncertainty allows: 6.84e-15 ± 0.06e-15
export const spread = (value, std) => {
  if (!std || !Number.isFinite(std)) return figure(value);
  const digits = Math.min(Math.max(Math.floor(Math.log10(Math.abs(value) || std)) - Math.floor(Math.log10(std)) + 2, 1), 8);
  return `${figure(value, digits)} ± ${figure(std, 2)}`;
};

export const chance = (p) => (p === null || p === undefined ? "–" : p < 1e-6 ? "< 1e-6" : figure(p, 2));
export const percent = (share) => `${(100 * share).toFixed(share > 0.1 ? 0 : 1)} %`;

// s as a person says them
export const duration = (seconds) => (seconds < 90 ? `${Math.round(seconds)} s` : seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${figure(seconds / 3600, 2)} h`);
