"""The contract that every process shares: messages, keys, random streams, programs and the two transports."""
