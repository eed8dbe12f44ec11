/*
 * A cache of the parts of a picture, with a limit of memory. The least recently used part is
 * evicted first. Values are functions of their keys only, so that the state of the cache never
 * affects a picture.
 *
 * Any thread. If two threads request the same value, the first one makes it while the other waits.
 * Nothing is locked while a value is made.
 */
#pragma once

#include <glib.h>

struct cache_key {
    guint64 words[4];
};

struct cache_entry {
    gpointer value; /* one block of g_malloc() */
};

typedef struct Cache Cache;

/* Makes a value. Returns a block to be freed with g_free(), and its size. The function may request
 * other keys from the cache, but keys must not depend on each other in a circle. */
typedef gpointer (*CacheMake)(const struct cache_key *key, gconstpointer data, gsize *ret_bytes);

Cache *cache_new(gsize limit_bytes);
void cache_free(Cache *cache); /* NULL is ignored */

/* Returns the value of a key. The value stays in the cache until cache_release(). */
struct cache_entry *cache_get(Cache *cache, const struct cache_key *key, CacheMake make,
                              gconstpointer data);
void cache_release(Cache *cache, struct cache_entry *entry);
