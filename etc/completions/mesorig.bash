# Completion of mesorig's command line for bash. “mesorig --complete WORD…” prints what may follow.
_mesorig() {
    mapfile -t COMPREPLY < <(command mesorig --complete "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null | cut -f 1)
    compopt -o filenames
    [[ ${COMPREPLY-} != */ ]] || compopt -o nospace
}
complete -F _mesorig mesorig
