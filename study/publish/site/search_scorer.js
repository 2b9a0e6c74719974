// Scores of Sphinx's search, which are its usual ones. The index contains each section of the report as a
// document "report#ID": its result is the address of the section.
var Scorer = {
  score: result => {
    const [page, id] = result[0].split("#")
    if (id) [result[0], result[2], result[3]] = [page, "#" + id, "section of the report"]
    return result[4]
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
}
