/*
 * Converts names of this server to origins, such as "http://rig.lab:8470". The header Host of a
 * request must name one of the server's origins, as a protection against DNS rebinding. A request
 * that a web page makes is accepted only if the page has the same origin. All functions are pure.
 */
#pragma once

#include <glib.h>

/* Returns the origin for a scheme and the value of a request's header Host. For example, "rig.lab"
 * becomes "http://rig.lab:80" or "https://rig.lab:443". Accepts only NAME, NAME:PORT, IPV4,
 * IPV4:PORT, [IPV6] and [IPV6]:PORT; a user name, leading zeros of the port and blanks are not
 * allowed. Returns NULL for any other text. Free the result with g_free(). */
char *web_origin_of_host(const char *scheme, const char *host);

/* Returns the origin in the value of a header Origin, such as "http://rig.lab:8470", with the port.
 * Returns NULL for any other text. Free the result with g_free(). */
char *web_origin_parse(const char *origin);

/* Returns the origin of the value of the option --host: NAME, NAME:PORT or an origin. A NAME
 * without a port gets the given port. Returns NULL for any other text. Free the result with
 * g_free(). */
char *web_origin_of_option(const char *text, guint port);
