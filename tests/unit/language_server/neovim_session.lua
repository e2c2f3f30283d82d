-- A session of a user: open a spec, read its findings, complete a key, hover, and quit.
-- Run as: nvim --headless -u NONE -S neovim_session.lua SPEC; the server's words are in R2BSPEC_LSP.

local server = vim.split(vim.env.R2BSPEC_LSP, " ")
local file = vim.fn.argv(0)
local limit_ms = 120000

local function say(name, text)
  io.stdout:write(name .. ": " .. text:gsub("\n", " ") .. "\n")
end

local function wait_for(what, condition)
  if not vim.wait(limit_ms, condition, 50) then
    say("timeout", what)
    vim.cmd("cquit 1")
  end
end

vim.cmd("edit " .. file)
local buffer = vim.api.nvim_get_current_buf()
local client = vim.lsp.start_client({
  name = "r2bspec",
  cmd = server,
  root_dir = vim.fn.fnamemodify(file, ":p:h"),
})
vim.lsp.buf_attach_client(buffer, client)

local function findings()
  return vim.diagnostic.get(buffer)
end

wait_for("findings of the saved text", function()
  return #findings() > 0
end)
say("finding", findings()[1].code .. " " .. findings()[1].message)

-- Mend the text in the buffer; nothing is saved.
local number = findings()[1].lnum
local line = vim.api.nvim_buf_get_lines(buffer, number, number + 1, true)[1]
vim.api.nvim_buf_set_lines(buffer, number, number + 1, true, { (line:gsub("Looping", "looping")) })
wait_for("no findings of the mended text", function()
  return #findings() == 0
end)
say("mended", tostring(#findings()))

local function ask(method, row, column)
  local params = {
    textDocument = vim.lsp.util.make_text_document_params(buffer),
    position = { line = row, character = column },
  }
  local answers = vim.lsp.buf_request_sync(buffer, method, params, limit_ms)
  return answers[client].result
end

local labels = {}
for _, item in ipairs(ask("textDocument/completion", number, #line - #"looping").items) do
  table.insert(labels, item.label)
end
table.sort(labels)
say("completion", table.concat(labels, " "))
say("hover", ask("textDocument/hover", number, 3).contents.value)
vim.cmd("qall!")
