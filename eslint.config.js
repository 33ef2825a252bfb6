import js from "@eslint/js";
import globals from "globals";

export default [
  { ignores: ["**/vendor/**", "**/_build/**", "**/.venv/**", "**/node_modules/**"] },
  js.configs.recommended,
  {
    files: ["**/*.js"],
    linterOptions: { reportUnusedDisableDirectives: "error" },
    languageOptions: { ecmaVersion: 2023, sourceType: "module" },
    rules: {
      "eqeqeq": "error", "no-var": "error", "prefer-const": "error", "no-eval": "error", "no-implied-eval": "error", "no-new-func": "error", "no-shadow": "error",
      "no-use-before-define": ["error", { functions: false, variables: false }], "no-else-return": "error", "object-shorthand": "error", "prefer-template": "error",
      "max-lines": ["error", 400], "max-lines-per-function": ["error", 150], "complexity": ["error", 20],
    },
  },
  { files: ["src/**/*.js"], languageOptions: { globals: { ...globals.browser, uPlot: "readonly" } } },
  { files: ["tests/js/**/*.js", "eslint.config.js"], languageOptions: { globals: globals.node } },
];
