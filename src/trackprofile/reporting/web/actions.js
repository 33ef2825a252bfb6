// The actions that limits require, from the most severe; colours are those of the palette.

export const ACTIONS = [
  { key: "immediate action", short: "immediate", property: "immediate-action", grade: 3 },
  { key: "intervention", short: "intervention", property: "intervention", grade: 2 },
  { key: "alert", short: "alert", property: "alert", grade: 1 },
  { key: "", short: "possible", property: "possible", grade: 0 },
];

export const actionOf = (key) => ACTIONS.find((action) => action.key === key) || ACTIONS[3];
export const actionOfGrade = (grade) => ACTIONS.find((action) => action.grade === grade) || ACTIONS[3];
export const actionText = (key) => key || "possible";
