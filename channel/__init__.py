"""The network as the adversary: impairments and attacks on links."""
