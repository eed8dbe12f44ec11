#compdef mesorig
# Completion of mesorig's command line for zsh. “mesorig --complete WORD…” prints what may follow.
_mesorig() {
    local line
    local -a folders others
    for line in "${(@f)$(command mesorig --complete "${(@Q)words[2,CURRENT]}" 2>/dev/null)}"; do
        case ${line%%$'\t'*} in
        '') ;;
        */) folders+=("${line%%$'\t'*}") ;;
        *) others+=("${${line%%$'\t'*}//:/\\:}:${line#*$'\t'}") ;;
        esac
    done
    compadd -f -S '' -a folders
    _describe argument others
}

if [[ $zsh_eval_context[-1] == loadautofunc ]]; then
    _mesorig "$@"
else
    compdef _mesorig mesorig
fi
