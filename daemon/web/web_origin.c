#include "web_origin.h"

#include <gio/gio.h>
#include <string.h>

#define DIGITS  "0123456789"
#define LETTERS "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"

/* Returns the port that a text contains, or 0 if the text is not a port from 1 to 65535. */
static guint parse_port(const char *text) {
    const gsize n = strlen(text);
    if (n == 0 || n > 5 || strspn(text, DIGITS) != n || *text == '0')
        return 0;
    const guint64 port = g_ascii_strtoull(text, NULL, 10);
    return port <= 65535 ? (guint)port : 0;
}

char *web_origin_of_host(const char *scheme, const char *host) {
    const gboolean bracket = *host == '[';
    const char *end = host;
    if (bracket) {
        end += 1 + strspn(host + 1, DIGITS "abcdefABCDEF:.");
        g_autofree char *ip = g_strndup(host + 1, (gsize)(end - host) - 1);
        if (*end != ']' || !g_hostname_is_ip_address(ip))
            return NULL;
        end++;
    } else {
        end += strspn(host, LETTERS DIGITS "-._");
    }
    guint port = strcmp(scheme, "https") == 0 ? 443 : 80;
    if (end == host || (*end && *end != ':') || (*end == ':' && !(port = parse_port(end + 1))))
        return NULL;
    g_autofree char *name = g_strndup(host, (gsize)(end - host));
    g_autofree char *lower = g_ascii_strdown(name, -1);
    return g_strdup_printf("%s://%s:%u", scheme, lower, port);
}

char *web_origin_parse(const char *origin) {
    static const char *const schemes[] = {"http", "https"};
    for (gsize i = 0; i < G_N_ELEMENTS(schemes); i++) {
        const gsize n = strlen(schemes[i]);
        if (strncmp(origin, schemes[i], n) == 0 && strncmp(origin + n, "://", 3) == 0)
            return web_origin_of_host(schemes[i], origin + n + 3);
    }
    return NULL;
}

char *web_origin_of_option(const char *text, guint port) {
    if (strstr(text, "://"))
        return web_origin_parse(text);
    g_autofree char *alone = web_origin_of_host("http", text);
    if (!alone || strchr(*text == '[' ? strchr(text, ']') : text, ':'))
        return g_steal_pointer(&alone);
    g_autofree char *at_port = g_strdup_printf("%s:%u", text, port);
    return web_origin_of_host("http", at_port);
}
