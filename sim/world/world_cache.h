/*
 * A cache of the parts of a picture, within a limit of memory: the least recently used part is
 * evicted first. Values are functions of their keys only, so that the state of the cache never
 * affects a picture.
 *
 * Any thread. A value that two threads ask for is made once, by the first, while the other waits;
 * nothing is locked while a value is made.
 */
#pragma once

#include <glib.h>

struct cache_key {
    guint64 words[4];
};

struct cache_entry {
    gpointer value; /* one g_malloc()ed block */
};

typedef struct Cache Cache;

/* Makes a value: returns a block to be freed with g_free(), and its size. It may ask the cache for
 * other keys, but not so that keys depend on each other in a circle. */
typedef gpointer (*CacheMake)(const struct cache_key *key, gconstpointer data, gsize *ret_bytes);

Cache *cache_new(gsize limit_bytes);
void cache_free(Cache *cache); /* NULL is ignored */

/* The value stays until cache_release(). */
struct cache_entry *cache_get(Cache *cache, const struct cache_key *key, CacheMake make,
                              gconstpointer data);
void cache_release(Cache *cache, struct cache_entry *entry);
