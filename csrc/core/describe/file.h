/* file.h - a tree of fields in a file: offsets in place of addresses, checked once.
 *
 *  at
 *   0  "pmalpha" and a zero      16  bytes of the file          40  check sum of what follows
 *   8  u32 version, 1            24  number of nodes            48  zero, to 64
 *  12  u32 0x01020304            32  where data begin           64  nodes, then data
 *
 * Numbers have 64 bits where nothing else is said, the low byte first. Nodes are those of field.h,
 * node 0 the root; children are in the order of their parents, each the child of one. Arrays begin
 * at multiples of 64, words at multiples of 8 and end with a zero. Nothing in a file is code or an
 * address. */
#ifndef PMA_FILE_H
#define PMA_FILE_H

#include <stddef.h>
#include <stdint.h>

#include "describe/field.h"
#include "status.h"

#define PMA_FILE_VERSION 2

/* Four sums of every fourth 64-bit word (FNV-1a), and one of these: against accidents. */
uint64_t pma_file_sum(const void *bytes, size_t size);

/* The check sum that a file has in its header. */
uint64_t pma_file_sum_of(const void *bytes);

/* Bytes of all arrays together, by those of the file: so often an array may be that of a node. */
enum { PMA_FILE_SHARES = 8 };

/* The tree of a file, whose bytes, at a multiple of 8, are only read and have to outlive it. All
 * children, words and arrays are then inside. PMA_REFUSED, with the reason in out->refusal. */
pma_status pma_file_read(const void *bytes, size_t size, pma_fields *out);

#endif
