"""Safe reinforcement learning of spacecraft inspection and rendezvous."""
