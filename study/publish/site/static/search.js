// Browsers let no script read other pages of a site that is opened from a local folder: results have no extracts there
DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = location.protocol != 'file:'

// The key "/" moves the cursor to the search box that is visible: a page has one for wide and one for narrow windows
Documentation.focusSearchBar = () =>
  [...document.querySelectorAll('input[name=q]')].find(box => box.offsetParent)?.focus()
