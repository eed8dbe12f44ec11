/*
 * Which names this server has, as origins: "http://rig.lab:8470". A request must be meant for one
 * of them (against DNS rebinding), and may come from a page of the same one only. Pure functions.
 */
#pragma once

#include <glib.h>

/* The origin of what a request's header Host names, for a scheme: "rig.lab" is
 * "http://rig.lab:80" or "https://rig.lab:443". Takes NAME, NAME:PORT, IPV4, IPV4:PORT, [IPV6] and
 * [IPV6]:PORT, and nothing else: no user, no leading zeros, no blank. NULL: it is something else;
 * g_free(). */
char *web_origin_of_host(const char *scheme, const char *host);

/* The same of a header Origin, "http://rig.lab:8470". */
char *web_origin_parse(const char *origin);

/* The same of the option --host: NAME is at this port, NAME:PORT, or an origin. */
char *web_origin_of_option(const char *text, guint port);
