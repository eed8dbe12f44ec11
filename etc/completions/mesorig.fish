# Completion of mesorig's command line for fish. “mesorig --complete WORD…” prints what may follow.
function __mesorig_complete
    set -l words (commandline -opc) "$(commandline -ct)"
    command mesorig --complete $words[2..-1] 2>/dev/null
end
complete -c mesorig -f -a '(__mesorig_complete)'
