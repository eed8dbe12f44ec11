#!/bin/bash
# A lamp on a pin of the computer, as a program for the driver program-lamps.
# usage: gpio-lamp.sh VALUE_FILE, for instance /sys/class/gpio/gpio17/value
# It does the same as gpio-lamp.py, without a library for JSON: mesorigd writes each request on one line,
# without spaces, so patterns can take a request apart. docs/build-a-rig/programs.md describes the requests.
value=$1
trap 'echo 0 >"$value"' EXIT # switches the lamp off, whatever ends this program

reply() {
    printf '{"jsonrpc":"2.0","id":%s,"%s":%s}\n' "$id" "${2:-result}" "$1"
}

# No request for ten seconds, or the end of the input: the lamp goes off.
while IFS= read -r -t 10 request; do
    id=null method=
    [[ $request =~ \"id\":([0-9]+) ]] && id=${BASH_REMATCH[1]}
    [[ $request =~ \"method\":\"([a-z]+)\" ]] && method=${BASH_REMATCH[1]}
    case $method in
    hello) reply '{"version":1,"class":"lamps","device":"lamp on a pin","capabilities":["silence"]}' ;;
    open) reply '{"lamps":1}' ;;
    set) [[ $request =~ \"on\":true ]] && echo 1 >"$value" || echo 0 >"$value" && reply '{}' ;;
    get) [[ $(<"$value") == 1 ]] && reply '{"on":[true]}' || reply '{"on":[false]}' ;;
    stop) echo 0 >"$value" && reply '{}' ;;
    close) echo 0 >"$value" && reply '{}' && exit ;;
    ping) reply '{}' ;;
    *) reply '{"code":1,"message":"this is no request"}' error ;;
    esac
done
