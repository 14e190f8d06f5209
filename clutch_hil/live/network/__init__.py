"""The network of a lab: certificates and files of each role."""
