// Shows the claims that fit the form above them; the choice is kept in the address.
const form = document.getElementById("filter")
const claims = [...document.querySelectorAll(".claim")]
const texts = claims.map(claim => claim.textContent.toLowerCase())

function fits(claim, text, wanted) {
  const words = (wanted.get("words") || "").toLowerCase().split(/\s+/)
  const own = claim.dataset
  return words.every(word => text.includes(word))
    && ["kind", "grade", "verdict"].every(key => !wanted.get(key) || own[key] == wanted.get(key))
    && (!wanted.get("section") || own.section.split(" ").includes(wanted.get("section")))
}

function show() {
  const wanted = new FormData(form)
  let count = 0
  claims.forEach((claim, i) => {
    claim.hidden = !fits(claim, texts[i], wanted)
    count += !claim.hidden
  })
  document.getElementById("count").value = `${count} of ${claims.length}`
  const given = [...wanted].filter(([, value]) => value)
  const query = new URLSearchParams(given).toString()
  history.replaceState(null, "", (query ? "?" + query : location.pathname) + location.hash)
}

new URLSearchParams(location.search).forEach((value, key) => {
  if (form.elements[key]) form.elements[key].value = value
})
form.addEventListener("input", show)
form.addEventListener("submit", event => event.preventDefault())
if (location.search) show()
