// The answers of the site's own search, without a browser: node docs/search.js build/docs/html "units".
const fs = require("fs");
const vm = require("vm");

const [site, ...questions] = process.argv.slice(2);
const page = { addEventListener: () => {}, getElementById: () => null, body: {} };
const context = vm.createContext({ document: page, localStorage: { setItem: () => {} } });
context.window = context;
const run = (text) => vm.runInContext(text, context);

run("var _ready = () => {}; var _ = (text) => text; var SPHINX_HIGHLIGHT_ENABLED = false;");
for (const name of ["language_data", "searchtools"])
  run(fs.readFileSync(`${site}/_static/${name}.js`, "utf8"));
run(fs.readFileSync(`${site}/searchindex.js`, "utf8"));
const answers = (question) => {
  context.question = question;
  return run("Search._performSearch(...Search._parseQuery(question))").reverse();
};
const found = questions.map((q) => [q, answers(q).map((x) => `${x[0]}${x[2]}`)]);
console.log(JSON.stringify(Object.fromEntries(found)));
