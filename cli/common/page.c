#include "page.h"

/* Numbers of CSS and SVG have decimal points, because the programs set no numeric locale. */
static const char head[] =
    "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
    "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
    "<meta name=\"color-scheme\" content=\"light dark\"><title>%s</title>\n<style>\n"
    ":root{--ink:#1d2126;--faint:#5c6570;--line:#d9dde2;--back:#fff;--soft:#f5f6f8;--pass:#1a7f4b;"
    "--warn:#9a6200;--fail:#b3202a}\n"
    "@media (prefers-color-scheme:dark){:root{--ink:#e6e8eb;--faint:#9aa3ad;--line:#3a4047;"
    "--back:#17191c;--soft:#202328;--pass:#56c48a;--warn:#e3ab4d;--fail:#f07f86}}\n"
    "body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--back);"
    "max-width:62em;margin:2em auto;padding:0 1em}\n"
    "h1{margin-bottom:0}h2{margin-top:2em}.faint{color:var(--faint)}\n"
    "table{border-collapse:collapse;margin:.5em 0}.wide{overflow-x:auto}\n"
    "td,th{padding:.25em .8em .25em 0;text-align:left;vertical-align:top;"
    "border-bottom:1px solid var(--line)}\n"
    "td.n,th.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}\n"
    "code{overflow-wrap:anywhere;font-size:90%%}\n"
    ".pass{color:var(--pass)}.warning{color:var(--warn)}.failure{color:var(--fail)}\n"
    ".pass,.warning,.failure{font-weight:600}\n"
    "figure{display:inline-block;margin:0 1em 1em 0;vertical-align:top;max-width:100%%}\n"
    "figure img{display:block;max-width:100%%;image-rendering:pixelated;border:1px solid "
    "var(--line)}\nfigcaption{font-size:13px;color:var(--faint);max-width:20em}\n"
    ".history svg{max-width:100%%;height:auto;background:#fff;border-radius:6px}\n"
    "@media print{body{font-size:10px;margin:0}details{display:block}}\n</style></head><body>\n";

void page_add(GString *to, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *text = g_markup_vprintf_escaped(format, arguments);
    va_end(arguments);
    g_string_append(to, text);
}

GString *page_begin(const char *title) {
    GString *to = g_string_new(NULL);
    page_add(to, head, title);
    return to;
}

void page_add_row(GString *to, const char *name, const char *value) {
    if (value && *value)
        page_add(to, "<tr><th>%s</th><td>%s</td></tr>\n", name, value);
}

void page_add_picture(GString *to, GBytes *png, const char *caption) {
    gsize size;
    const guint8 *bytes = g_bytes_get_data(png, &size);
    g_autofree char *base64 = g_base64_encode(bytes, size);
    page_add(to,
             "<figure><img alt=\"%s\" src=\"data:image/png;base64,%s\"><figcaption>%s</figcaption>"
             "</figure>\n",
             caption, base64, caption);
}

char *page_end(GString *page) {
    g_string_append(page, "</body></html>\n");
    return g_string_free(page, FALSE);
}
